// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/render.hpp"

#include <atomic>
#include <cmath>
#include <numbers>

#include <fmt/format.h>
#include <tbb/blocked_range.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include "camera/detail/render_checks.hpp"
#include "camera/detail/shader.hpp"
#include "camera/detail/thin_lens.hpp"
#include "camera/disc_samples.hpp"
#include "camera/ray_scene.hpp"
#include "core/check.hpp"
#include "core/random.hpp"

namespace maquette::camera {
namespace {

constexpr int kTile = 16;             ///< pixels; 16 x 16 rays stay in one part of the tree
constexpr std::ptrdiff_t kBlock = 4;  ///< pixels; 4 x 4 rays go together
constexpr std::size_t kLanes = 16;
constexpr std::size_t kLitLamps = 8;  ///< as many as Image::lit has bits
constexpr double kDegrees = 180.0 / std::numbers::pi;
constexpr int kFirstLook = 16;  ///< samples before noise is judged
constexpr double kDark = 0.02;  ///< of white: below, noise is measured against this

/// Streams of random numbers of one pixel.
enum Stream : std::uint64_t {
  kPlace = 0,
  kLens = 1,
  kGather = 64,
  kBounce = 65,
  kOpening = 66,
  kPass = 128
};

struct View {
  Vec3 eye;
  RigidTransform model_from_camera;
  double pitch_mm, focal_mm, middle_x, middle_y, aspect, skew;

  View(const CameraModel& camera, const RigidTransform& pose)
      : eye(pose.translation_mm),
        model_from_camera(pose),
        pitch_mm(1e-3 * camera.pixel_pitch_um),
        focal_mm(camera.focal_length_mm),
        middle_x(std::isnan(camera.principal_x_px) ? 0.5 * camera.width_px : camera.principal_x_px),
        middle_y(std::isnan(camera.principal_y_px) ? 0.5 * camera.height_px
                                                   : camera.principal_y_px),
        aspect(camera.aspect),
        skew(camera.skew_px * pitch_mm / focal_mm) {}
  [[nodiscard]] Vec3 direction(double x_px, double y_px) const {
    const double down = pitch_mm * (y_px - middle_y) / aspect;
    return normalized(model_from_camera.direction(
        {pitch_mm * (x_px - middle_x) - skew * down, -down, -focal_mm}));
  }
  /// direction() of as many places as a block has pixels, in place.
  void directions(std::array<double, kLanes>& x_px, std::array<double, kLanes>& y_px,
                  std::array<double, kLanes>& z) const {
    for (std::size_t i = 0; i < kLanes; ++i) {
      const Vec3 way = direction(x_px[i], y_px[i]);
      x_px[i] = way.x, y_px[i] = way.y, z[i] = way.z;
    }
  }
};

bool is_grey(const Bands& b) {
  return b[0] == b[1] && b[1] == b[2];
}
bool is_grey(const std::array<Grid<float>, 3>& factor) {
  return factor[0] == factor[1] && factor[1] == factor[2];
}
bool is_grey(const Material& m) {
  struct Grey {
    bool operator()(const Lambert& l) const { return is_grey(l.albedo); }
    bool operator()(const LommelSeeliger& l) const { return is_grey(l.albedo); }
    bool operator()(const LunarLambert& l) const { return is_grey(l.albedo); }
    bool operator()(const Hapke& h) const { return is_grey(h.w); }
    bool operator()(const OrenNayar& o) const { return is_grey(o.albedo); }
    bool operator()(const Ggx& g) const { return is_grey(g.n) && is_grey(g.k) && is_grey(g.tint); }
    bool operator()(const BrdfTable& t) const {
      for (const Bands& f : t.grid->brdf)
        if (!is_grey(f)) return false;
      return true;
    }
  };
  if (m.map && !is_grey(m.map->factor)) return false;
  return std::visit(Grey{}, m.law);
}
bool is_grey(const Lighting& lighting) {
  for (const Lamp& lamp : lighting.lamps)
    if (!is_grey(lamp.colour)) return false;
  for (const Panel& panel : lighting.panels)
    if (!is_grey(panel.radiance)) return false;
  return is_grey(lighting.ambient);
}

Image empty_image(const CameraModel& camera, bool grey, bool geometry) {
  const std::ptrdiff_t rows = camera.height_px, cols = camera.width_px;
  const Grid<float> nothing(geometry ? rows : 0, geometry ? cols : 0, NAN);
  std::vector<Grid<float>> bands;
  for (int b = 0; b < (grey ? 1 : 3); ++b) bands.emplace_back(rows, cols, 0.0F);
  return {std::move(bands),
          Grid<float>(rows, cols, std::numeric_limits<float>::infinity()),
          Grid<std::uint8_t>(rows, cols, 0),
          {nothing, nothing, nothing},
          {nothing, nothing, nothing},
          nothing,
          nothing,
          nothing,
          Grid<float>(nothing.rows(), nothing.cols(), 0.0F)};
}

std::uint8_t lit_bit(std::size_t lamp) {
  return static_cast<std::uint8_t>(1U << lamp);
}

/// Up to 4 x 4 pixels that are worked on together.
struct Block {
  std::size_t lanes = 0;
  std::array<std::ptrdiff_t, kLanes> row, col;
  std::array<std::uint64_t, kLanes> key;  ///< of the pixel's random numbers
  std::array<RayScene::Ray, kLanes> rays;
  std::array<std::optional<RayHit>, kLanes> hits;
  std::array<Bands, kLanes> sum;
  std::array<double, kLanes> square;  ///< sum of squares of the middle band, per sample
  std::array<int, kLanes> samples;
  std::array<std::uint8_t, kLanes> lit;  ///< by which lamps
  std::array<Bands, kLanes> light;       ///< in the last sample
  // Lanes that meet something, one after the other.
  std::array<std::size_t, kLanes> of;
  std::array<detail::Seen, kLanes> seen;
  std::array<detail::Lit, kLanes> arrived;
  bool open = true;                                    ///< wants more samples
  std::vector<std::vector<DiscPoint>> lens;            ///< points of one pass, per light and lane
  std::array<std::vector<DiscPoint>, kLanes> opening;  ///< of the camera, per lane
  std::vector<DiscPoint> points;
};

class Renderer {
 public:
  Renderer(const RayScene& scene, const detail::Shader& shader, const View& view,
           const detail::ThinLens& lens, const RenderOptions& options)
      : scene_(scene),
        shader_(shader),
        view_(view),
        lens_(lens),
        options_(options),
        side_(static_cast<int>(std::lround(std::sqrt(options.samples_per_pixel)))) {}

  /// @return samples taken
  std::int64_t block(Image& image, std::ptrdiff_t top, std::ptrdiff_t left, Block& b) const {
    begin(image, top, left, b);
    for (int pass = 0; b.open; ++pass) {
      spread(b, pass);
      for (int s = 0; s < options_.samples_per_pixel; ++s) sample(b, pass, s);
      judge(b);
    }
    std::int64_t taken = 0;
    for (std::size_t i = 0; i < b.lanes; ++i) {
      taken += b.samples[i];
      if (lit_by_sample()) image.lit(b.row[i], b.col[i]) = b.lit[i];
      const double scale = options_.exposure_scale / b.samples[i];
      if (image.bands.size() == 1) {
        image.bands[0](b.row[i], b.col[i]) =
            static_cast<float>(scale * options_.white_balance[1] * b.sum[i][1]);
        continue;
      }
      for (std::size_t k = 0; k < 3; ++k)
        image.bands[k](b.row[i], b.col[i]) =
            static_cast<float>(scale * options_.white_balance[k] * b.sum[i][k]);
    }
    return taken;
  }

 private:
  /// Lanes, their centre rays, and what those see.
  void begin(Image& image, std::ptrdiff_t top, std::ptrdiff_t left, Block& b) const {
    const Grid<float>& frame = image.bands[0];
    std::array<double, kLanes> x{}, y{}, z;
    b.lanes = 0;
    b.open = true;
    for (std::ptrdiff_t r = top; r < std::min(frame.rows(), top + kBlock); ++r)
      for (std::ptrdiff_t c = left; c < std::min(frame.cols(), left + kBlock); ++c) {
        const std::size_t i = b.lanes++;
        b.row[i] = r;
        b.col[i] = c;
        b.key[i] = random_bits(options_.seed, static_cast<std::uint64_t>(r * frame.cols() + c));
        x[i] = static_cast<double>(c) + 0.5, y[i] = static_cast<double>(r) + 0.5;
        b.sum[i] = {};
        b.square[i] = 0.0;
        b.lit[i] = 0;
        b.samples[i] = 0;
      }
    view_.directions(x, y, z);
    for (std::size_t i = 0; i < b.lanes; ++i) b.rays[i] = {view_.eye, {x[i], y[i], z[i]}};
    trace(b);
    mark_lit(image, b);
    for (std::size_t i = 0; i < b.lanes; ++i)
      if (b.hits[i]) record(image, b.row[i], b.col[i], b.rays[i].direction, *b.hits[i]);
  }

  /// Where light of the lamps' centres arrives, unless the samples will say so.
  void mark_lit(Image& image, Block& b) const {
    if (shader_.lights().empty() || lit_by_sample()) return;
    const std::size_t n = seen(b, [](std::size_t) { return DiscPoint{}; });
    for (std::size_t l = 0; l < std::min(kLitLamps, shader_.lights().size()); ++l) {
      shader_.direct({b.seen.data(), n}, shader_.lights()[l], {b.arrived.data(), n});
      for (std::size_t k = 0; k < n; ++k)
        if (b.arrived[k].arrives) image.lit(b.row[b.of[k]], b.col[b.of[k]]) |= lit_bit(l);
    }
  }

  /// Lanes that meet something, each with a place of a lens. @return how many
  template <class Lens>
  std::size_t seen(Block& b, const Lens& lens) const {
    std::size_t n = 0;
    for (std::size_t i = 0; i < b.lanes; ++i) {
      if (!b.hits[i]) continue;
      b.of[n] = i;
      b.seen[n++] = {&*b.hits[i], b.rays[i].direction, lens(i)};
    }
    return n;
  }

  /// The one sample is the pixel's centre and the lamps are points: their light is the mask.
  [[nodiscard]] bool lit_by_sample() const {
    const auto& lights = shader_.lights();
    const auto marked = static_cast<std::ptrdiff_t>(std::min(kLitLamps, lights.size()));
    return side_ == 1 && !lens_.open() && options_.noise_target <= 0.0 && !lights.empty() &&
           std::none_of(lights.begin(), lights.begin() + marked,
                        [](const Light& light) { return light.extended(); });
  }

  void trace(Block& b) const {
    scene_.first_hits({b.rays.data(), b.lanes}, {b.hits.data(), b.lanes});
  }

  void record(Image& image, std::ptrdiff_t r, std::ptrdiff_t c, Vec3 view,
              const RayHit& hit) const {
    image.depth_mm(r, c) = static_cast<float>(hit.distance_mm);
    if (!options_.geometry) return;
    const Light* light = shader_.lights().empty() ? nullptr : &shader_.lights().front();
    const auto put = [&](std::array<Grid<float>, 3>& to, Vec3 v) {
      to[0](r, c) = static_cast<float>(v.x);
      to[1](r, c) = static_cast<float>(v.y);
      to[2](r, c) = static_cast<float>(v.z);
    };
    put(image.normal, hit.normal);
    put(image.position_mm, hit.point_mm);
    image.part(r, c) = static_cast<float>(hit.object + 1);
    const auto angle = [](Vec3 a, Vec3 b) {
      return static_cast<float>(kDegrees * std::atan2(norm(cross(a, b)), dot(a, b)));
    };
    image.emission_deg(r, c) = angle(-view, hit.normal);
    if (light == nullptr) return;
    const Vec3 to_light = light->arrive(hit.point_mm, {}).direction;
    image.incidence_deg(r, c) = angle(to_light, hit.normal);
    image.phase_deg(r, c) = angle(to_light, -view);
  }

  /// Points of the lenses for one pass.
  void spread(Block& b, int pass) const {
    const auto& lights = shader_.lights();
    b.lens.resize(lights.size() * kLanes);
    for (std::size_t l = 0; l < lights.size(); ++l)
      for (std::size_t i = 0; i < b.lanes; ++i)
        if (lights[l].extended())
          stratified_disc(options_.samples_per_pixel * options_.lamp_samples,
                          stream(b, i, pass, kLens + l), b.lens[l * kLanes + i]);
    if (!lens_.open()) return;
    for (std::size_t i = 0; i < b.lanes; ++i)
      stratified_disc(options_.samples_per_pixel, stream(b, i, pass, kOpening), b.opening[i]);
  }

  /// Sample s of pass `pass` of every pixel.
  void sample(Block& b, int pass, int s) const {
    if (side_ > 1 || pass > 0 || lens_.open()) {
      const auto draw = 2 * static_cast<std::uint64_t>(s);
      std::array<double, kLanes> x{}, y{}, z;
      for (std::size_t i = 0; i < b.lanes; ++i) {
        const std::uint64_t place = stream(b, i, pass, kPlace);
        x[i] = static_cast<double>(b.col[i]) + (s % side_ + random_uniform(place, draw)) / side_;
        y[i] =
            static_cast<double>(b.row[i]) + (s / side_ + random_uniform(place, draw + 1)) / side_;
      }
      view_.directions(x, y, z);
      for (std::size_t i = 0; i < b.lanes; ++i) {
        const Vec3 way{x[i], y[i], z[i]};
        b.rays[i] = lens_.open() ? lens_.through(b.opening[i][static_cast<std::size_t>(s)], way)
                                 : RayScene::Ray{view_.eye, way};
      }
      trace(b);
    }
    shine(b, s);
    for (std::size_t i = 0; i < b.lanes; ++i) {
      if (b.hits[i] && shader_.gathers()) gather(b, i, pass, s);
      const Bands value =
          b.hits[i] ? b.light[i] : shader_.background(b.rays[i].origin_mm, b.rays[i].direction);
      for (std::size_t k = 0; k < 3; ++k) b.sum[i][k] += value[k];
      b.square[i] += value[1] * value[1];
      ++b.samples[i];
    }
  }

  [[nodiscard]] static std::uint64_t stream(const Block& b, std::size_t lane, int pass,
                                            std::uint64_t what) {
    return random_bits(b.key[lane], static_cast<std::uint64_t>(pass) * kPass + what);
  }

  /// Light of the lamps in sample s.
  void shine(Block& b, int s) const {
    b.light.fill({});
    for (std::size_t l = 0; l < shader_.lights().size(); ++l) {
      const Light& light = shader_.lights()[l];
      const int count = light.extended() ? options_.lamp_samples : 1;
      for (int k = 0; k < count; ++k) {
        const std::size_t n = seen(b, [&](std::size_t i) {
          return light.extended() ? b.lens[l * kLanes + i][static_cast<std::size_t>(s * count + k)]
                                  : DiscPoint{};
        });
        shader_.direct({b.seen.data(), n}, light, {b.arrived.data(), n});
        for (std::size_t m = 0; m < n; ++m) {
          if (l < kLitLamps && b.arrived[m].arrives) b.lit[b.of[m]] |= lit_bit(l);
          for (std::size_t j = 0; j < 3; ++j)
            b.light[b.of[m]][j] += b.arrived[m].radiance[j] / count;
        }
      }
    }
  }

  /// Light of the surroundings and of other surfaces.
  void gather(Block& b, std::size_t i, int pass, int s) const {
    stratified_disc(options_.gather_samples,
                    random_bits(stream(b, i, pass, kGather), static_cast<std::uint64_t>(s)),
                    b.points);
    const Bands got =
        shader_.gathered(*b.hits[i], b.rays[i].direction, b.points,
                         random_bits(stream(b, i, pass, kBounce), static_cast<std::uint64_t>(s)));
    for (std::size_t j = 0; j < 3; ++j) b.light[i][j] += got[j];
  }

  /// A block goes on until all its pixels are good enough: one that happens to see only light or
  /// only shadow beside a penumbra is not taken for good. The variance of single samples is an
  /// upper bound for the stratified mean's, so the target is kept.
  void judge(Block& b) const {
    b.open = options_.noise_target > 0.0 &&
             b.samples[0] + options_.samples_per_pixel <= options_.max_samples;
    if (!b.open) return;
    bool more = false;
    for (std::size_t i = 0; i < b.lanes; ++i) {
      const double n = b.samples[i], mean = b.sum[i][1] / n;
      const double variance = std::max(0.0, b.square[i] / n - mean * mean) / std::max(n - 1.0, 1.0);
      more = more || n < kFirstLook ||
             std::sqrt(variance) > options_.noise_target * std::max(mean, kDark);
    }
    b.open = more;
  }

  const RayScene& scene_;
  const detail::Shader& shader_;
  const View& view_;
  const detail::ThinLens& lens_;
  const RenderOptions& options_;
  int side_;
};

/// The lens of a camera, focused.
Result<detail::ThinLens> focused(const CameraModel& camera, const RigidTransform& pose,
                                 const View& view, const RayScene& scene) {
  if (camera.lens.f_number == 0.0) return detail::ThinLens();
  double focus = camera.lens.focus_mm;
  if (focus == 0.0) {
    const Vec3 way = view.direction(0.5 * camera.width_px, 0.5 * camera.height_px);
    const auto hit = scene.first_hit(view.eye, way);
    focus = hit ? hit->distance_mm * dot(way, pose.direction({0.0, 0.0, -1.0})) : INFINITY;
  }
  if (!(focus > camera.focal_length_mm))
    return fail(kCameraOutOfRange,
                fmt::format("the lens is focused at {:.3f} mm, nearer than its focal length of {} "
                            "mm; give a focus farther away",
                            focus, camera.focal_length_mm));
  const detail::ThinLens lens(camera, pose, focus);
  MAQUETTE_TRY_VOID(detail::check_lens_above_ground(scene, lens));
  return lens;
}

}  // namespace

struct PreparedScene::State {
  RayScene scene;
  std::vector<SceneObject> objects;
  bool grey;
};

PreparedScene::PreparedScene(std::unique_ptr<State> state) : state_(std::move(state)) {}
PreparedScene::PreparedScene(PreparedScene&&) noexcept = default;
PreparedScene& PreparedScene::operator=(PreparedScene&&) noexcept = default;
PreparedScene::~PreparedScene() = default;

Result<PreparedScene> PreparedScene::build(const std::vector<SceneObject>& objects,
                                           const RunContext& run) {
  std::vector<RayObject> bodies;
  bool grey = true, anything = false;
  const auto look_at_material = [&](const Material& material) {
    const double most = largest_albedo(material.law);
    if (most > 1.0 + 1e-2)
      run.warn(fmt::format("material {}: gives back up to {:.2f} of the light it gets",
                           material.name, most));
    grey = grey && is_grey(material);
  };
  for (const SceneObject& object : objects) {
    const bool mesh = object.mesh != nullptr && !object.mesh->triangles.empty();
    if (object.cover != nullptr && mesh) {
      MAQUETTE_TRY_VOID(check_cover(*object.cover, *object.mesh));
      for (const Material& material : object.cover->materials) look_at_material(material);
      for (const auto& picture : object.cover->pictures)
        grey = grey && (picture == nullptr || is_grey(picture->factor));
    } else {
      MAQUETTE_TRY_VOID(check_material(object.material));
      look_at_material(object.material);
    }
    bodies.push_back({mesh ? object.mesh : nullptr, object.field, object.base_mm,
                      object.model_from_mesh, object.scale});
    anything = anything || mesh || object.field != nullptr;
  }
  if (!anything)
    return fail(kEmptyScene, "the scene has no triangle; give at least one mesh or field");
  MAQUETTE_TRY(auto scene, RayScene::build(bodies, run));
  return PreparedScene(std::make_unique<State>(State{std::move(scene), objects, grey}));
}

Result<Image> PreparedScene::render(const CameraModel& camera,
                                    const RigidTransform& model_from_camera,
                                    const Lighting& lighting, const RenderOptions& options,
                                    const RunContext& run) const {
  MAQUETTE_TRY_VOID(detail::check_camera(camera, model_from_camera));
  MAQUETTE_TRY_VOID(detail::check_lighting(lighting));
  MAQUETTE_TRY_VOID(detail::check_options(options));
  const View view(camera, model_from_camera);
  const RayScene& scene = state_->scene;
  const detail::Shader shader(scene, state_->objects, lighting, options);
  MAQUETTE_TRY_VOID(detail::check_above_ground(scene, view.eye));
  MAQUETTE_TRY(const auto lens, focused(camera, model_from_camera, view, scene));
  for (const Light& light : shader.lights())
    MAQUETTE_TRY_VOID(detail::check_lamp_in_the_open(scene, light));

  const bool grey = state_->grey && is_grey(lighting) && is_grey(options.white_balance);
  Image image = empty_image(camera, grey, options.geometry);
  const std::ptrdiff_t rows = camera.height_px, cols = camera.width_px;
  const Renderer renderer(scene, shader, view, lens, options);
  const std::ptrdiff_t tiles_across = (cols + kTile - 1) / kTile;
  const std::ptrdiff_t tiles = tiles_across * ((rows + kTile - 1) / kTile);
  std::atomic<std::ptrdiff_t> done{0};
  std::atomic<std::int64_t> samples{0};
  tbb::enumerable_thread_specific<Block> blocks;
  tbb::parallel_for(tbb::blocked_range<std::ptrdiff_t>(0, tiles, 1), [&](const auto& range) {
    Block& block = blocks.local();
    for (std::ptrdiff_t tile = range.begin(); tile < range.end(); ++tile) {
      const std::ptrdiff_t top = tile / tiles_across * kTile, left = tile % tiles_across * kTile;
      for (std::ptrdiff_t r = top; r < std::min(rows, top + kTile); r += kBlock) {
        if (run.stopped()) return;
        for (std::ptrdiff_t c = left; c < std::min(cols, left + kTile); c += kBlock)
          samples += renderer.block(image, r, c, block);
      }
      const std::ptrdiff_t now = ++done;
      if (now % 16 == 0 || now == tiles)
        run.progress(static_cast<double>(now) / static_cast<double>(tiles));
    }
  });
  if (run.stopped()) return fail(kCancelled, "stopped while the picture was rendered");
  image.mean_samples = static_cast<double>(samples) / static_cast<double>(rows * cols);
  return image;
}

Result<Image> render(const std::vector<SceneObject>& objects, const CameraModel& camera,
                     const RigidTransform& model_from_camera, const Lamp& lamp,
                     const RenderOptions& options, const RunContext& run) {
  // Bad options are found before the scene is built.
  MAQUETTE_TRY_VOID(detail::check_camera(camera, model_from_camera));
  MAQUETTE_TRY_VOID(check_lamp(lamp));
  MAQUETTE_TRY_VOID(detail::check_options(options));
  MAQUETTE_TRY(const auto scene, PreparedScene::build(objects, run));
  return scene.render(camera, model_from_camera, {{lamp}, {}, {}}, options, run);
}

RigidTransform look_at(Vec3 position_mm, Vec3 target_mm, Vec3 up) {
  const Vec3 back = normalized(position_mm - target_mm);  // camera z
  Vec3 right = cross(up, back);
  // Straight up or down: north is up in the picture.
  if (norm(right) <= 1e-9 * norm(up)) right = cross(Vec3{0, 1, 0}, back);
  right = normalized(right);
  const Vec3 top = cross(back, right);
  // Rotation matrix with columns right, top, back to quaternion: Shepperd 1978,
  // doi:10.2514/3.55767b (divide by the largest component).
  const double xx = right.x, yy = top.y, zz = back.z;
  const std::array<double, 4> weight{xx + yy + zz, xx - yy - zz, yy - xx - zz, zz - xx - yy};
  const auto largest = std::max_element(weight.begin(), weight.end()) - weight.begin();
  Quaternion q;
  const double root = std::sqrt(1.0 + weight[static_cast<std::size_t>(largest)]);
  const double k = 0.5 / root;
  switch (largest) {
    case 0:
      q = {0.5 * root, k * (top.z - back.y), k * (back.x - right.z), k * (right.y - top.x)};
      break;
    case 1:
      q = {k * (top.z - back.y), 0.5 * root, k * (right.y + top.x), k * (back.x + right.z)};
      break;
    case 2:
      q = {k * (back.x - right.z), k * (right.y + top.x), 0.5 * root, k * (top.z + back.y)};
      break;
    default:
      q = {k * (right.y - top.x), k * (back.x + right.z), k * (top.z + back.y), 0.5 * root};
  }
  return {normalized(q), position_mm};
}

}  // namespace maquette::camera
