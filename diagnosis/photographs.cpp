// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/photographs.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>

#include <fmt/format.h>

#include "camera/srgb.hpp"
#include "core/random.hpp"
#include "core/run_part.hpp"
#include "diagnosis/controls.hpp"
#include "diagnosis/detail/model_search.hpp"
#include "diagnosis/detail/photo_bodies.hpp"
#include "diagnosis/detail/photo_fit.hpp"
#include "diagnosis/detail/photo_remainder.hpp"
#include "diagnosis/detail/photo_search.hpp"
#include "diagnosis/detail/photo_standing.hpp"
#include "diagnosis/extended_model.hpp"
#include "diagnosis/surface.hpp"
#include "heightmap/field_io.hpp"

namespace maquette::diagnosis {
namespace {

using detail::kAll;
using detail::kReport;
using detail::PhotoCandidate;
using detail::PhotoFit;
using detail::PhotoLinear;
using detail::PhotoMember;
using detail::PhotoMembers;

constexpr std::size_t kLeastPixels = 3000;
/// As far beside a stone or its shadow pixels are not compared, as at the part's rim.
constexpr std::ptrdiff_t kBesideBody_px = 10;
/// What is smooth over the part and larger than that, of the pictures' mean, is no noise.
constexpr double kSmooth = 3e-3;
/// The scatter of pixels must be off by this factor to be called a cause: full well and read noise
/// are known to a few per cent.
constexpr double kScatterOff = 0.1;
/// By more where what is left, rms, is larger than that scatter: so much for each scatter more, at
/// most so much in all. Slopes between nodes other than rendered left 1.32 scatters, and a tenth
/// of the noise to neighbours.
constexpr double kScatterOffBesideMore = 0.5, kScatterOffMost = 0.3;

double rms_of(const PhotoLinear& linear, int set, std::size_t* count) {
  double sum = 0.0, n = 0.0;
  for (Eigen::Index i = 0; i < linear.residual.size(); ++i) {
    if (linear.set[static_cast<std::size_t>(i)] != set) continue;
    sum += std::pow(static_cast<double>(linear.residual(i) * linear.sigma(i)), 2);
    n += 1.0;
  }
  if (count != nullptr) *count = static_cast<std::size_t>(n);
  return 255.0 * std::sqrt(sum / std::fmax(1.0, n));
}

/// rms of the noise that the pixels' own scatter shows.
double noise_rms(const detail::PhotoViews& views, double factor) {
  double sum = 0.0, n = 0.0;
  for (const auto& p : views.pixels())
    for (std::size_t ch = 0; ch < views.channels(); ++ch) {
      sum += static_cast<double>(p.variance[ch]);
      n += 1.0;
    }
  return 255.0 * factor * std::sqrt(sum / std::fmax(1.0, n));
}

/// Held-out photographs beside what two models expect.
std::vector<Diagnosis::HeldOut> held_out_of(PhotoFit& fit, const PhotoMembers& members,
                                            double noise_factor) {
  const PhotoScene& scene = fit.views().scene();
  std::vector<Diagnosis::HeldOut> all(scene.photos.size());
  std::vector<double> count(scene.photos.size(), 0.0);
  const std::size_t channels = fit.views().channels();
  for (const bool after : {false, true}) {
    static_cast<void>(fit.about(after ? members : PhotoMembers{}, {}));
    for (const auto& p : fit.views().pixels()) {
      const PhotoInput& photo = scene.photos[p.photo];
      const auto number = [&](double v) {
        return 255.0 * (photo.srgb ? static_cast<double>(camera::srgb_of_linear(
                                         static_cast<float>(std::clamp(v, 0.0, 1.0))))
                                   : v);
      };
      for (std::size_t ch = 0; ch < channels; ++ch) {
        const double expected = fit.views().number_of(p, ch, p.value[ch]);
        const double measured = static_cast<double>(p.measured[ch]);
        Diagnosis::HeldOut& h = all[p.photo];
        (after ? h.after : h.before) += std::abs(number(measured) - number(expected));
        if (!after) continue;
        const double sigma = noise_factor * std::sqrt(static_cast<double>(p.variance[ch]));
        // Mean absolute value of a normal distribution.
        h.noise += std::sqrt(2.0 / std::numbers::pi) *
                   (number(expected + 0.5 * sigma) - number(expected - 0.5 * sigma));
        count[p.photo] += 1.0;
      }
    }
  }
  std::vector<Diagnosis::HeldOut> out;
  for (std::size_t k = 0; k < all.size(); ++k)
    if (count[k] > 0.0)
      out.push_back({scene.photos[k].image.filename().string(), all[k].before / count[k],
                     all[k].after / count[k], all[k].noise / count[k]});
  return out;
}

Result<PhotoScene> scene_of(const std::vector<PhotoInput>& photos) {
  PhotoScene scene;
  scene.photos = photos;
  std::vector<Vec3> lamps;
  for (PhotoInput& p : scene.photos) {
    if (std::isnan(p.principal_u_px)) p.principal_u_px = 0.5 * p.width_px;
    if (std::isnan(p.principal_v_px)) p.principal_v_px = 0.5 * p.height_px;
    const double length = std::sqrt(p.model_from_camera.w * p.model_from_camera.w +
                                    p.model_from_camera.x * p.model_from_camera.x +
                                    p.model_from_camera.y * p.model_from_camera.y +
                                    p.model_from_camera.z * p.model_from_camera.z);
    if (!(length > 0.5))
      return fail(kPhotograph, fmt::format("{}: camera_quaternion_wxyz is no rotation; expected w, "
                                           "x, y, z with squares that add up to 1",
                                           p.image.string()));
    p.model_from_camera = normalized(p.model_from_camera);
    if (!(norm(p.lamp_position_mm - p.lamp_target_mm) > 0.0))
      return fail(kPhotograph,
                  fmt::format("{}: lamp_position_mm and lamp_target_mm are the same place; say "
                              "where the lamp stands and where it points to",
                              p.image.string()));
    std::size_t lamp = 0;
    while (lamp < lamps.size() && norm(lamps[lamp] - p.lamp_position_mm) > 1e-6) ++lamp;
    if (lamp == lamps.size()) lamps.push_back(p.lamp_position_mm);
    scene.lamp_of.push_back(lamp);
  }
  scene.lamps = lamps.size();
  return scene;
}

std::vector<PhotoCandidate> candidates_of(const PhotoScene& scene) {
  std::vector<PhotoCandidate> all;
  for (const Effect& e : library()) {
    if (!e.photo_forms) continue;
    auto forms = e.photo_forms(scene);
    if (!forms.empty()) all.push_back({&e, std::move(forms)});
  }
  return all;
}

/// What the model has already (extended.toml).
Result<PhotoMembers> known_members(const std::vector<KnownCause>& known,
                                   const std::vector<PhotoCandidate>& candidates) {
  PhotoMembers members;
  for (const KnownCause& k : known) {
    const Effect* effect = find_effect(k.effect);
    if (effect == nullptr || !effect->photo_forms) continue;
    for (const PhotoCandidate& c : candidates) {
      if (c.effect != effect) continue;
      for (const PhotoForm& f : c.forms) {
        if (f.law != k.law) continue;
        PhotoMember m{effect, f, std::vector<double>(f.parameters.size(), 0.0)};
        for (std::size_t i = 0; i < f.parameters.size(); ++i)
          for (const auto& [name, value] : k.parameters)
            if (name == f.parameters[i].key) m.values[i] = value;
        members.push_back(std::move(m));
      }
    }
    if (members.empty() || members.back().effect != effect)
      return fail(kUnknownCause, fmt::format("[[cause]] {}: no law \"{}\"; take it from a "
                                             "diagnosis of the same photographs",
                                             k.effect, k.law));
  }
  return members;
}

/// A search and what it found.
struct Named {
  PhotoMembers members;
  Diagnosis d;
  double scatter = 1.0;  ///< of neighbouring pixels, over the declared noise
};

/// The smallest of those that explain too little beside what remains unexplained: many a thing
/// without a name looks a little like each, and a map, a light from one side, or a factor for each
/// picture takes the better part of it (a reflex in the lens is a map of albedo in the middle of
/// all pictures, a second lamp a bright side of the sky). members.size(): none.
/// @param declared_255  rms of the noise as declared
std::size_t beside_unknown(const PhotoLinear& linear, const PhotoMembers& members,
                           const Diagnosis& d, double declared_255) {
  constexpr double kOfOneLaw = 1.5, kOfMany = 5.0;
  constexpr std::size_t kMany = 3;  // parameters
  // A fine pattern scatters neighbours as noise does: it is no noise.
  const auto& kinds = d.remainder.kinds;
  const bool pattern = std::find(kinds.begin(), kinds.end(), detail::kWaveInPicture) != kinds.end();
  const double noise_255 = pattern ? std::fmin(declared_255, d.rms_noise) : d.rms_noise;
  const double left_255 =
      std::sqrt(std::fmax(0.0, d.rms_after * d.rms_after - noise_255 * noise_255));
  std::size_t weakest = members.size();
  double least = 1.0;
  for (std::size_t k = 0; k < members.size(); ++k) {
    const double own_255 = 255.0 * moved_by(linear, members[k]) * own_share(linear, members, k);
    const double wanted = members[k].form.parameters.size() < kMany ? kOfOneLaw : kOfMany;
    if (const double share = own_255 / (wanted * left_255); share < least) {
      least = share;
      weakest = k;
    }
  }
  return weakest;
}

/// The ambient light among them whose sky would be darker than black opposite where it is bright,
/// by more than it is bright on average: half a sky that is black asks for half of that, a second
/// lamp for three times as much. members.size(): none.
std::size_t impossible_sky(const PhotoFit& fit, const PhotoMembers& members) {
  constexpr double kDarker = 1.5;
  for (std::size_t k = 0; k < members.size(); ++k) {
    if (members[k].effect->name != "lamp.ambient") continue;
    const PhotoState s = fit.state_of({members[k]});
    if (darkest_sky(s) < -kDarker * std::fmax(0.0, s.ambient_sky)) return k;
  }
  return members.size();
}

/// The same with an offset of the numbers in the place of ambient light, fitted, where that does as
/// well (to a hundredth of what it gains, as equivalent names do); else empty.
PhotoMembers offset_for_light(PhotoMembers members, const std::vector<PhotoCandidate>& candidates,
                              PhotoFit& fit) {
  const auto light = std::find_if(members.begin(), members.end(), [](const PhotoMember& m) {
    return m.effect->name == "lamp.ambient";
  });
  const auto offset =
      std::find_if(candidates.begin(), candidates.end(),
                   [](const PhotoCandidate& c) { return c.effect->name == "photo.black_level"; });
  if (light == members.end() || offset == candidates.end() || offset->forms.empty()) return {};
  const double before = fit.objective(members, kAll);
  const auto at = static_cast<std::size_t>(light - members.begin());
  const double missed = fit.objective(fit.fitted(detail::without(members, at)), kAll);
  *light = {offset->effect, offset->forms[0],
            std::vector<double>(offset->forms[0].parameters.size(), 0.0)};
  members = fit.fitted(std::move(members));
  const double close = std::fmax(detail::kEquivalent, 0.01 * (missed - before));
  return fit.objective(members, kAll) < before + close ? members : PhotoMembers{};
}

/// rms of what is finer than the waves of a map: it is as uneven, and no cause of its own.
double finer_than_maps(const PhotoLinear& linear, const PhotoMembers& members) {
  constexpr double kFiner = 0.25;  // of what the map moves; blotches of a centimetre: 0.17 to 0.24
  double sum = 0.0;
  for (const PhotoMember& m : members)
    if (detail::is_map(m.form)) sum = std::hypot(sum, kFiner * moved_by(linear, m));
  return sum;
}

bool knows(const std::vector<KnownCause>& known, const std::string& effect) {
  return std::any_of(known.begin(), known.end(),
                     [&](const KnownCause& k) { return k.effect == effect; });
}

/// @param whole  with maps, dependences and equivalents; else causes and verdict alone
Result<Named> named(PhotoFit& fit, const std::vector<PhotoCandidate>& candidates,
                    const detail::Layout& layout, bool noise_known, bool whole,
                    const RunContext& run) {
  Named out;
  Diagnosis& d = out.d;
  d.unit = "/ 255";
  const detail::PhotoViews& views = fit.views();
  const PhotoLinear before = fit.about({}, {});
  d.rms_before = rms_of(before, kReport, &d.n_report);
  double light = 0.0;
  for (const auto& p : views.pixels()) light += static_cast<double>(p.measured[0]);
  light /= static_cast<double>(views.pixels().size());
  const auto first_pixels = views.pixels();
  detail::PhotoSearch search(fit, candidates, light);

  PhotoMembers& members = out.members;
  members = search.choose(d.ranking, run);
  if (run.stopped()) return fail(kCancelled, "the diagnosis was cancelled");
  run.progress(0.6);
  std::vector<double> p_values;
  const std::size_t declared = fit.known.size();
  members = confirmed(std::move(members), fit, light, p_values, d.rejected);
  run.progress(0.7);

  PhotoLinear after;
  detail::PhotoScatter scatter;
  bool told_by_scatter = false, from_one_side = false;
  while (true) {
    after = fit.about(members, parameters_of(members));
    d.rms_after = rms_of(after, kReport, nullptr);
    scatter = detail::scatter_of(views);
    d.rms_noise = noise_rms(views, scatter.factor);
    d.remainder =
        detail::judge_photographs(after, views, layout, fit.noise.factor, scatter,
                                  255.0 * kSmooth * light, 255.0 * finer_than_maps(after, members));
    if (from_one_side) {
      d.remainder.kinds.emplace_back("light from one side");
      d.remainder.found = true;
      d.remainder.share = 1.0;
    }
    std::size_t drop = impossible_sky(fit, members);
    const bool no_sky = drop < members.size();
    from_one_side |= no_sky;
    if (drop == members.size() && d.remainder.found)
      drop = beside_unknown(after, members, d, d.rms_noise / scatter.factor);
    if (drop == members.size()) {
      if (noise_known || d.remainder.found || told_by_scatter || !(scatter.off() > kScatterOff))
        break;
      // Light has shot noise, an offset of the numbers has none.
      told_by_scatter = true;
      PhotoMembers instead = offset_for_light(members, candidates, fit);
      if (instead.empty()) break;
      static_cast<void>(fit.about(instead, parameters_of(instead)));
      if (const auto its = detail::scatter_of(views); its.off() < kScatterOff)
        members = std::move(instead);
      continue;
    }
    d.rejected.push_back({members[drop].effect->name,
                          no_sky ? "opposite where it is bright its sky would be darker than black"
                                 : "explains too little beside what remains unexplained"});
    p_values.erase(p_values.begin() + static_cast<std::ptrdiff_t>(drop));
    members = fit.fitted(without(std::move(members), drop));
  }
  out.scatter = scatter.factor;
  const bool unnamed = fit.known.size() > declared;
  if (whole && !unnamed) detail::show_photographs(before, first_pixels, after, views, layout, d);
  std::vector<double> gains(members.size(), 0.0);
  for (std::size_t k = 0; k < members.size(); ++k) {
    Cause c;
    const PhotoMember& m = members[k];
    c.effect = m.effect->name;
    c.law = m.form.law;
    c.parameters = sizes_of(after, fit, members, k);
    c.fixed = m.form.fixed;
    for (std::size_t i = 0; i < m.values.size(); ++i)
      c.raw.emplace_back(m.form.parameters[i].key, m.values[i]);
    c.separate_by = m.effect->separate_by;
    c.p_value = p_values[k];
    d.causes.push_back(std::move(c));
  }
  for (std::size_t k = 0; whole && k < members.size(); ++k) {
    d.causes[k].equivalent = search.equivalents(members, k, gains[k], d.rejected);
    run.progress(0.7 + 0.3 * static_cast<double>(k + 1) / static_cast<double>(members.size()));
  }
  if (unnamed) {  // that is not in the model
    fit.known.resize(declared);
    after = fit.about(members, {});
    d.rms_after = rms_of(after, kReport, nullptr);
    if (whole) detail::show_photographs(before, first_pixels, after, views, layout, d);
  }
  double all = 1e-300;
  for (const double g : gains) all += std::fmax(0.0, g);
  for (std::size_t k = 0; k < members.size(); ++k)
    d.causes[k].share = std::clamp(gains[k] / all, 0.0, 1.0);

  // What has no name scatters neighbours, too, and so does what is left at edges, by less.
  const double off =
      std::clamp(kScatterOff + kScatterOffBesideMore * (d.rms_after / d.rms_noise - 1.0),
                 kScatterOff, kScatterOffMost);
  if (!noise_known && !d.remainder.found && scatter.off() > off) {
    Cause c;
    const Effect* effect = find_effect("photo.noise");
    c.effect = effect->name;
    c.law = "scatter of neighbouring pixels";
    c.parameters = {{"factor", scatter.factor, scatter.sigma},
                    {"factor_dark", scatter.dark, scatter.sigma_of_third},
                    {"factor_light", scatter.light, scatter.sigma_of_third}};
    c.raw = {{"factor", scatter.factor}};
    c.separate_by = effect->separate_by;
    c.p_value = std::fmax(1e-300, std::erfc(4.0 + (scatter.off() - off) / scatter.sigma_of_third));
    d.causes.push_back(std::move(c));
  }
  d.verdict = d.causes.empty()    ? (d.remainder.found ? "unexplained" : "consistent")
              : d.remainder.found ? "partly_explained"
                                  : "explained";
  return out;
}

/// The same search on pictures simulated from what was found. @post `views` show these
Result<Controls> controls_of(detail::PhotoViews& views, const PhotoFit& fit, const Named& found,
                             const std::vector<PhotoCandidate>& candidates,
                             const detail::Layout& layout, bool noise_known, std::uint64_t seed,
                             const RunContext& run) {
  Controls c;
  views.simulate(fit.state_of(found.members), fit.normals, found.scatter, mix64(seed));
  c.points = views.pixels().size();
  noise_known |= std::any_of(found.d.causes.begin(), found.d.causes.end(),
                             [](const Cause& cause) { return cause.effect == "photo.noise"; });
  for (const bool recovery : {false, true}) {
    if (recovery && found.members.empty()) break;
    PhotoFit again(views, layout);
    again.normals = fit.normals;
    again.known = fit.known;
    std::vector<PhotoCandidate> rest = candidates;
    if (!recovery) {
      again.known.insert(again.known.end(), found.members.begin(), found.members.end());
      for (const PhotoMember& m : found.members)
        std::erase_if(rest, [&](const PhotoCandidate& k) { return k.effect == m.effect; });
    }
    MAQUETTE_TRY(const Named back, named(again, rest, layout, noise_known, false,
                                         part(run, recovery ? 0.7 : 0.6, recovery ? 1.0 : 0.7)));
    if (recovery) {
      std::vector<Cause> injected = found.d.causes;
      injected.resize(found.members.size());  // without the scatter's
      recover(injected, back.d.causes, c);
    } else {
      c.null_verdict = back.d.verdict;
      for (const Cause& cause : back.d.causes) c.null_claims.push_back(cause.effect);
    }
  }
  return c;
}

void note_bodies(const detail::BodyPixels& bodies, const CaseInput& part,
                 std::vector<std::string>& notes) {
  double left_out = 0.0, all = 0.0;
  for (const Grid<std::uint8_t>& of : bodies.left_out)
    for (const std::uint8_t pixel : of.cells()) {
      left_out += pixel;
      all += 1.0;
    }
  if (!(all > 0.0)) return;
  const char* what = part.bodies.empty()   ? "a stone"
                     : part.ground.empty() ? "an object"
                                           : "a stone, an object";
  notes.push_back(
      fmt::format("photographs: pixels within {} of {} or its shadow ({:.1f} %) have no say",
                  kBesideBody_px, what, 100.0 * left_out / all));
  for (std::size_t i = 0; i < part.bodies.size(); ++i)
    if (bodies.pixels[i] == 0)
      notes.push_back(
          fmt::format("photographs: none shows {}; is its position in mm of the model frame, and "
                      "its scale right?",
                      part.bodies[i].mesh.filename().string()));
}

}  // namespace

Result<Diagnosis> diagnose_photographs(const CaseInput& part, const std::vector<PhotoInput>& photos,
                                       bool with_controls, const RunContext& run) {
  MAQUETTE_TRY(PhotoScene scene, scene_of(photos));
  const auto held =
      std::count_if(photos.begin(), photos.end(), [](const PhotoInput& p) { return p.held_out; });
  if (held == std::ssize(photos))
    return fail(kPhotograph, fmt::format("{}: all photographs have held_out = true; leave at least "
                                         "one to choose by",
                                         photos.front().image.string()));
  MAQUETTE_TRY(const auto design, heightmap::read_model_field(part.design));
  MAQUETTE_TRY(const auto ground, read_ground(part, design));
  const heightmap::ModelField& bare = ground ? *ground : design;
  std::vector<detail::Photograph> taken;
  bool milled = false;
  for (const PhotoInput& p : scene.photos) {
    MAQUETTE_TRY(auto photo, detail::read_photograph(p));
    milled |= p.as_milled && !part.programs.empty();
    taken.push_back(std::move(photo));
  }
  scene.colour = std::all_of(taken.begin(), taken.end(),
                             [](const detail::Photograph& p) { return p.value.size() == 3; });
  if (!scene.colour)
    for (auto& p : taken) p.value.resize(1);
  std::optional<heightmap::ModelField> built;
  if (milled) {
    MAQUETTE_TRY(const auto model, ExtendedModel::make(part, run));
    built = model.cut();
    if (part.coat_mm > 0.0 || !part.known.empty()) model.build(*built);
  }
  std::vector<const heightmap::ModelField*> surfaces;
  for (const PhotoInput& p : scene.photos)
    surfaces.push_back(p.as_milled && built ? &*built : &bare);
  scene.box = maquette::diagnosis::scene_of(design, nullptr, 0.5 * part.ball_diameter_mm).box;
  detail::BodyPixels bodies;
  if (ground || !part.bodies.empty()) {
    MAQUETTE_TRY(bodies, detail::pixels_of_bodies(scene, design, ground ? &*ground : nullptr,
                                                  part.bodies, kBesideBody_px, run));
  }
  run.progress(0.05);

  const auto layout = detail::lay_out(scene.box, part.seed);
  std::vector<detail::Photograph> shown_later(taken.size());
  for (std::size_t k = 0; k < taken.size(); ++k)
    if (scene.photos[k].held_out) std::swap(taken[k], shown_later[k]);
  detail::PhotoViews views(scene, std::move(taken), surfaces, bodies.left_out);
  PhotoFit fit(views, layout);
  auto candidates = candidates_of(scene);
  MAQUETTE_TRY(fit.known, known_members(part.known, candidates));
  for (const PhotoMember& m : fit.known)
    std::erase_if(candidates, [&](const PhotoCandidate& c) { return c.effect == m.effect; });

  // Facets, patches or smooth slopes: what no cause makes, differences of neighbouring pixels,
  // decides.
  fit.settle_normals({});
  if (views.pixels().size() < kLeastPixels)
    return fail(kPhotograph,
                fmt::format("{} pixels of the lattice show the surface; at least {} are needed: do "
                            "camera_position_mm and camera_quaternion_wxyz look at the part?",
                            views.pixels().size(), kLeastPixels));
  run.progress(0.2);

  const bool noise_known = knows(part.known, "photo.noise");
  MAQUETTE_TRY(Named found, named(fit, candidates, layout, noise_known, true,
                                  maquette::part(run, 0.2, with_controls ? 0.6 : 0.95)));
  Diagnosis& d = found.d;
  if (held > 0) {
    detail::PhotoViews others(scene, std::move(shown_later), surfaces, bodies.left_out, true);
    PhotoFit expected(others, layout);
    expected.known = fit.known;
    expected.normals = fit.normals;
    d.held_out = held_out_of(expected, found.members, found.scatter);
  }
  note_bodies(bodies, part, d.notes);
  const std::map<detail::Normals, const char*> kinds{
      {detail::Normals::smooth, "smooth between nodes"},
      {detail::Normals::smoother, "smooth between nodes, of fourth order"},
      {detail::Normals::patches, "those of bilinear patches"},
      {detail::Normals::facets, "those of facets"}};
  d.notes.push_back(
      fmt::format("photographs: slopes of the surface are {}", kinds.at(fit.normals)));
  if (with_controls) {
    MAQUETTE_TRY(d.controls,
                 controls_of(views, fit, found, candidates, layout, noise_known, part.seed, run));
    if (!d.controls->passed()) d.notes.push_back("a control did not pass: see the report");
  }
  run.progress(1.0);
  return std::move(d);
}

}  // namespace maquette::diagnosis
