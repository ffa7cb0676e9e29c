// SPDX-License-Identifier: GPL-3.0-or-later
#include "challenge/photo_case.hpp"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <optional>
#include <stdexcept>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "challenge/photo_blur.hpp"
#include "heightmap/field_io.hpp"

namespace challenge {
namespace {

constexpr double kLightGrid = 1.0;  // mm, of openness and of bounced light
constexpr int kLightRays = 144;
constexpr int kWeighed = 6;  // of 6 x 6 pixels one, where neighbours do not matter

std::string list(Vec3 v) {
  return fmt::format("[{:.6f}, {:.6f}, {:.6f}]", v.x, v.y, v.z);
}

/// What light gives in the planes of a picture, without noise.
class Dark {
 public:
  Dark(const PhotoWorld& world, const Relief& relief, std::uint64_t seed)
      : world_(world), seed_(seed) {
    scene_.relief = &relief;
    scene_.paint = world.paint;
    scene_.ambient = world.ambient;
    if (world.ambient[1] > 0)
      scene_.openness = openness_of(relief, world.room, kLightGrid, kLightRays, seed + 3);
    if (world.bounce > 0)
      for (int k = 0; k < kLamps; ++k) {
        Field f = bounced_light(relief, world.paint, world.photos[static_cast<std::size_t>(k)].lamp,
                                world.bounces, kLightGrid, kLightRays, seed + 4);
        for (double& v : f.z) v *= world.bounce;
        bounced_[static_cast<std::size_t>(k)] = std::move(f);
      }
  }

  /// @param stride  over 1: no blur, no stains
  Picture develop(int photo, int stride) const {
    const Photo& p = world_.photos[static_cast<std::size_t>(photo)];
    const Lens lens = stride == 1 ? p.lens : without_blur(p.lens);
    const int even = margin_of(lens), by_place = place_margin_of(lens, p.camera, *scene_.relief);
    Picture picture =
        render(scene_, p.camera, p.lamp, bounced_[static_cast<std::size_t>(photo % kLamps)],
               even + by_place, stride, seed_ + 100 + static_cast<unsigned>(photo));
    blur_by_place(lens, p.camera, *scene_.relief, by_place, even, picture);
    pass(lens, picture);
    if (stride == 1)
      for (const auto& stain : world_.stains) stain(picture, photo);
    return picture;
  }

 private:
  static Lens without_blur(Lens lens) {
    lens.defocus_px = lens.pupil_mm = 0;
    lens.motion_px = {0, 0};
    lens.turning_rad = {};
    return lens;
  }
  const PhotoWorld& world_;
  std::uint64_t seed_;
  PhotoScene scene_;
  std::array<Field, kLamps> bounced_;
};

bool needs_neighbours(const PhotoWorld& w) {
  bool blurred = !w.stains.empty();
  for (const Photo& p : w.photos)
    blurred |=
        margin_of(p.lens) > 0 || p.lens.pupil_mm > 0 || maquette::norm(p.lens.turning_rad) > 0;
  return blurred;
}

/// Fills PhotoHidden's weights: the declared world's pictures against those with the effect alone.
void weigh(PhotoHidden& h, const PhotoWorld& declared, const PhotoWorld& alone,
           const Relief& relief, std::uint64_t seed) {
  const int stride = needs_neighbours(alone) ? 1 : kWeighed;
  const Dark before(declared, relief, seed), after(alone, relief, seed);
  double squares = 0, ratio = 0, seen = 0;
  for (int k = 0; k < kPhotos; ++k) {
    const Picture a = before.develop(k, stride), b = after.develop(k, stride);
    const Sensor& was = declared.photos[static_cast<std::size_t>(k)].sensor;
    const Sensor& is = alone.photos[static_cast<std::size_t>(k)].sensor;
    for (std::size_t band = 0; band < a.size(); ++band)
      for (std::size_t i = 0; i < a[band].v.size(); ++i) {
        const double u = static_cast<double>(a[band].v[i]),
                     light = static_cast<double>(b[band].v[i]);
        const double v = expected(is, band, light);
        const double sigma = noise_of(was.full_well_e, was.read_noise_e, u),
                     noise = noise_of(is.full_well_e, is.read_noise_e, u);
        const double more = (noise * noise + is.pixels * is.pixels * u * u) / (sigma * sigma) - 1;
        ratio += (v - u) * (v - u) / (sigma * sigma);
        if (is.full_well_e != was.full_well_e || is.read_noise_e != was.read_noise_e ||
            is.pixels > 0)
          ratio += 0.5 * more * more;
        if (u > 0) {
          squares += (v - u) * (v - u);
          seen += 1;
        }
      }
  }
  h.over_noise = stride * std::sqrt(ratio);
  h.rms_255 = 255 * std::sqrt(squares / std::max(1.0, seen));
}

void write_design(const Field& design, const std::filesystem::path& file) {
  maquette::heightmap::ModelField f{
      maquette::Grid<float>(design.n, design.n), maquette::Millimetres{design.step}, {}, {}};
  for (int r = 0; r < design.n; ++r)
    for (int c = 0; c < design.n; ++c) f.z_mm(r, c) = static_cast<float>(design.at(r, c));
  if (const auto done = maquette::heightmap::write_model_field(f, file); !done)
    throw std::runtime_error(done.error().message);
}

std::string case_text(const PhotoWorld& w, int held_out) {
  std::string toml = "schema = \"maquette.case/1\"\ndesign = \"design.tif\"\n";
  for (int k = 0; k < kPhotos; ++k) {
    const Photo& p = w.photos[static_cast<std::size_t>(k)];
    const maquette::Quaternion q = p.camera.turn;
    toml += fmt::format(
        "\n[[photo]]\nimage = \"photo_{}.exr\"\nencoding = \"linear\"\nresolution_px = [{}, {}]\n"
        "pixel_pitch_um = {:.4f}\nfocal_length_mm = {:.4f}\n",
        k + 1, p.camera.width, p.camera.height, w.pixel_pitch_um, w.focal_mm);
    toml += fmt::format("camera_position_mm = {}\n", list(p.camera.place));
    toml += fmt::format("camera_quaternion_wxyz = [{:.12f}, {:.12f}, {:.12f}, {:.12f}]\n", q.w, q.x,
                        q.y, q.z);
    toml += fmt::format("lamp_position_mm = {}\nlamp_target_mm = {}\n", list(p.lamp.place),
                        list(p.lamp.target));
    toml += fmt::format(
        "lamp_diameter_mm = 0.0\nlamp_beam_deg = {:.4f}\nexposure_scale = {:.12g}\nalbedo = "
        "{:.12g}\nreflectance = \"lambert\"\nfull_well_e = {:.6g}\nread_noise_e = {:.6g}\n"
        "surface = \"design\"\n",
        2 * p.lamp.beam_half * 180 / kPi, p.lamp.scale, w.paint.albedo, p.sensor.full_well_e,
        p.sensor.read_noise_e);
    if (k >= kPhotos - held_out) toml += "held_out = true\n";
  }
  return toml;
}

/// As many digits as the case file has, so that what is declared is what is meant.
double rounded(double v, double unit) {
  return std::round(v / unit) * unit;
}
Vec3 rounded(Vec3 v) {
  return {rounded(v.x, 1e-6), rounded(v.y, 1e-6), rounded(v.z, 1e-6)};
}

}  // namespace

PhotoWorld draw_photo_world(const PhotoOptions& options, Draw& d) {
  PhotoWorld w;
  w.design = draw_terrain(d);
  const double side = w.design.step * (w.design.n - 1);
  const Vec3 middle{side / 2, side / 2, w.design.height(side / 2, side / 2)};
  constexpr std::array<double, 3> kFocal{28, 35, 50};
  w.focal_mm = kFocal[static_cast<std::size_t>(d.uniform(0, 3))];
  w.pixel_pitch_um = 8.45 * 1024 / options.width;
  const double focal_px = 1e3 * w.focal_mm / w.pixel_pitch_um;
  w.paint.albedo = rounded(d.uniform(0.2, 0.6), 1e-3);
  const double scale = rounded(d.uniform(0.45, 0.7) / w.paint.albedo, 1e-4);

  std::array<PhotoLamp, kLamps> lamps;
  const double azimuth0 = d.uniform(0, 2 * kPi), turn = d.sign() * d.uniform(1.0, kPi);
  const int low = static_cast<int>(d.uniform(0, kLamps));
  for (int k = 0; k < kLamps; ++k) {
    PhotoLamp& lamp = lamps[static_cast<std::size_t>(k)];
    // One high, one low: a low one's shadows tell how wide it is.
    const double azimuth = azimuth0 + k * turn,
                 elevation = (k == low ? d.uniform(11, 24) : d.uniform(24, 50)) * kPi / 180,
                 distance = 1000 * std::pow(3.5, d.uniform(0, 1));
    lamp.target = rounded(middle + Vec3{d.uniform(-5, 5), d.uniform(-5, 5), 0});
    lamp.place = rounded(lamp.target + distance * direction(azimuth, elevation));
    lamp.reference = maquette::norm(lamp.place - lamp.target);
    lamp.scale = scale;
    lamp.beam_half = 28 * kPi / 180;
  }
  const double around = d.uniform(0, 2 * kPi);
  for (int pose = 0; pose < kPoses; ++pose) {
    const double azimuth = around + (pose + d.uniform(-0.25, 0.25)) * 2 * kPi / kPoses,
                 elevation = d.uniform(45, 82) * kPi / 180,
                 distance = d.uniform(780, 980) * w.focal_mm / 35;
    PhotoCamera camera;
    camera.width = options.width;
    camera.height = options.height;
    camera.focal_px = focal_px;
    camera.place = rounded(middle + distance * direction(azimuth, elevation));
    camera.turn = looking(camera.place, middle + Vec3{d.uniform(-8, 8), d.uniform(-8, 8), 0},
                          d.uniform(-0.1, 0.1));
    for (int k = 0; k < kLamps; ++k) {
      Photo& photo = w.photos[static_cast<std::size_t>(pose * kLamps + k)];
      photo.camera = camera;
      photo.lamp = lamps[static_cast<std::size_t>(k)];
    }
  }
  return w;
}

std::vector<PhotoHidden> make_photo_case(const PhotoOptions& options,
                                         const std::filesystem::path& folder) {
  Draw d{std::mt19937_64(options.seed * 7919 + 13)};
  const PhotoWorld declared = draw_photo_world(options, d);
  const Relief relief(declared.design, options.between);
  PhotoWorld world = declared;
  std::vector<PhotoHidden> hidden;
  for (std::size_t k = 0; k < options.effects.size(); ++k) {
    const double size = options.size * (k < options.sizes.size() ? options.sizes[k] : 1.0);
    const Draw own{std::mt19937_64(options.seed * 7919 + 101 + k)};
    Draw here = own, twin = own;
    hidden.push_back(hide_in_photos(options.effects[k], size, world, here));
    if (!options.weigh) continue;
    PhotoWorld alone = declared;
    hide_in_photos(options.effects[k], size, alone, twin);
    weigh(hidden.back(), declared, alone, relief, options.seed);
  }

  std::filesystem::create_directories(folder);
  write_design(declared.design, folder / "design.tif");
  const Dark dark(world, relief, options.seed);
  for (int k = 0; k < kPhotos; ++k) {
    Picture picture = dark.develop(k, 1);
    expose(world.photos[static_cast<std::size_t>(k)].sensor, picture, options.seed * 31 + 7, k);
    write_picture(picture, folder / fmt::format("photo_{}.exr", k + 1));
  }
  std::ofstream(folder / "case.toml") << case_text(declared, options.held_out);
  nlohmann::ordered_json truth{{"schema", "maquette.photo_truth/1"}, {"seed", options.seed}};
  truth["effects"] = nlohmann::ordered_json::array();
  for (const PhotoHidden& h : hidden) {
    nlohmann::ordered_json parameters = nlohmann::ordered_json::object();
    for (const auto& [name, value] : h.parameters) parameters[name] = value;
    truth["effects"].push_back({{"effect", h.effect},
                                {"size_factor", h.size},
                                {"photographs", h.photographs},
                                {"parameters", parameters},
                                {"rms_255", h.rms_255},
                                {"over_noise", h.over_noise}});
  }
  std::ofstream(folder / "truth.json") << truth.dump(2) << "\n";
  return hidden;
}

}  // namespace challenge
