// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/feeds.hpp"

#include <algorithm>
#include <numbers>

#include <fmt/format.h>

#include "cnc/motion_time.hpp"
#include "core/check.hpp"
#include "core/files.hpp"
#include "core/nearest_name.hpp"

namespace maquette::cnc {
namespace {

constexpr double kMostThinning = 4.0;
constexpr double kLeastOfDeepCuts = 0.25;
constexpr double kKeepWithin = 0.1;
/// The named feed is at most this much above what acceleration lets the move reach.
constexpr double kNamedWithin = 2.0;

/// Rounded down to three digits.
double rounded(double feed) {
  const double unit = std::pow(10.0, std::floor(std::log10(feed)) - 2.0);
  return std::floor(feed / unit * (1.0 + 1e-12)) * unit;
}

}  // namespace

Result<Material> parse_material(std::string_view text, std::string_view place) {
  Material m{};
  const DataKey keys[] = {
      {"name", &m.name},
      {"description", &m.description, -INFINITY, INFINITY, false},
      {"cutter_diameter_mm", &m.cutter_diameter_mm, 0.05, 500.0},
      {"chip_load_mm", &m.chip_load_mm, 1e-4, 5.0},
      {"max_depth_diameters", &m.max_depth_diameters, 0.01, 20.0},
      {"deep_cut_loss", &m.deep_cut_loss, 0.0, 1.0},
      {"min_surface_speed_m_min", &m.min_surface_speed_m_min, 0.1, 1e4},
      {"max_surface_speed_m_min", &m.max_surface_speed_m_min, 0.1, 1e4},
      {"plunge_share", &m.plunge_share, 0.01, 1.0},
  };
  MAQUETTE_TRY_VOID(read_data(text, place, keys));
  if (m.chip_load_mm.size() != m.cutter_diameter_mm.size())
    return fail(kDataFile, fmt::format("{}: {} diameters, but {} chip loads", place,
                                       m.cutter_diameter_mm.size(), m.chip_load_mm.size()));
  for (std::size_t i = 1; i < m.cutter_diameter_mm.size(); ++i)
    if (!(m.cutter_diameter_mm[i] > m.cutter_diameter_mm[i - 1]))
      return fail(kDataFile,
                  fmt::format("{}: cutter_diameter_mm must ascend, but {} follows {}", place,
                              m.cutter_diameter_mm[i], m.cutter_diameter_mm[i - 1]));
  if (m.min_surface_speed_m_min > m.max_surface_speed_m_min)
    return fail(kDataFile,
                fmt::format("{}: min_surface_speed_m_min {} is above max_surface_speed_m_min {}",
                            place, m.min_surface_speed_m_min, m.max_surface_speed_m_min));
  return m;
}

std::vector<std::string> material_names() {
  return built_in_names("materials");
}

Result<Material> find_material(const std::string& name_or_path) {
  if (name_or_path.ends_with(".toml")) {
    constexpr std::size_t kLargestDataFile = 1 << 20;
    MAQUETTE_TRY(const std::string text, read_file(name_or_path, kLargestDataFile));
    return parse_material(text, name_or_path);
  }
  if (const std::string_view text = built_in_data("materials", name_or_path); !text.empty())
    return parse_material(text, name_or_path + ".toml");
  const std::string near = nearest_name(name_or_path, material_names());
  return fail(kUnknownMaterial,
              fmt::format("no material is called '{}'; known: {}, or the path of a .toml file{}",
                          name_or_path, fmt::join(material_names(), ", "),
                          near.empty() ? "" : fmt::format("; did you mean '{}'?", near)));
}

double engaged_diameter_mm(const Cutter& cutter, double depth_mm) {
  const double r = cutter.corner_radius_mm, ap = std::clamp(depth_mm, 0.0, r);
  return 2.0 * (cutter.radius_mm - r + std::sqrt(ap * (2.0 * r - ap)));
}

double chip_thinning(const Cutter& cutter, Engagement e) {
  if (!(e.depth_mm > 0.0) || !(e.width_mm > 0.0)) return 0.0;
  const double r = cutter.corner_radius_mm;
  const double diameter = engaged_diameter_mm(cutter, e.depth_mm);
  const double into = std::fmin(e.width_mm / diameter, 0.5);
  const double sin_phi = 2.0 * std::sqrt(into * (1.0 - into));
  const double rise = r > 0.0 ? std::fmin(e.depth_mm / r, 1.0) : 1.0;
  const double sin_kappa = std::sqrt(rise * (2.0 - rise));
  return sin_phi * sin_kappa;
}

double chip_load_mm(const Material& material, const Cutter& cutter, double depth_mm) {
  const double diameter = 2.0 * cutter.radius_mm;
  const auto& d = material.cutter_diameter_mm;
  const auto& h = material.chip_load_mm;
  double chip = h.back();
  if (diameter < d.front()) {
    chip = h.front() * diameter / d.front();
  } else if (diameter < d.back()) {
    const auto i =
        static_cast<std::size_t>(std::upper_bound(d.begin(), d.end(), diameter) - d.begin());
    const double t = (diameter - d[i - 1]) / (d[i] - d[i - 1]);
    chip = h[i - 1] + t * (h[i] - h[i - 1]);
  }
  const double deeper = std::fmax(0.0, depth_mm / diameter - material.max_depth_diameters);
  return chip * std::fmax(kLeastOfDeepCuts, 1.0 - material.deep_cut_loss * deeper);
}

double feed_per_tooth_mm(const Material& material, const Cutter& cutter, Engagement engagement,
                         double cusp_mm) {
  const double thinning = std::fmax(chip_thinning(cutter, engagement), 1.0 / kMostThinning);
  const double feed = chip_load_mm(material, cutter, engagement.depth_mm) / thinning;
  const double r = cutter.corner_radius_mm;
  return r > 0.0 ? std::fmin(feed, std::sqrt(8.0 * r * cusp_mm)) : feed;
}

Result<SpindleSpeed> spindle_speed(const Machine& machine, const Material& material,
                                   const Tool& tool, double deepest_mm) {
  // In air, or as good as: what the whole cutter may do.
  const double diameter =
      deepest_mm > 0.0 ? engaged_diameter_mm(tool.cutter, deepest_mm) : 2.0 * tool.cutter.radius_mm;
  const auto rpm_of = [&](double m_min) { return 1000.0 * m_min / (std::numbers::pi * diameter); };
  const double fastest = rpm_of(material.max_surface_speed_m_min);
  if (fastest < machine.min_spindle_rpm)
    return fail(kSpindleOutOfRange,
                fmt::format("tool {} ({}) in {} stands at most {:.0f} rpm ({} m/min at {:.3f} mm), "
                            "but {} turns no slower than {:.0f}; take a smaller diameter or depth",
                            tool.number, tool.name, material.name, fastest,
                            material.max_surface_speed_m_min, diameter, machine.name,
                            machine.min_spindle_rpm));
  SpindleSpeed speed;
  speed.rpm = std::clamp(rounded(std::fmin(fastest, machine.max_spindle_rpm)),
                         machine.min_spindle_rpm, machine.max_spindle_rpm);
  speed.surface_speed_m_min = speed.rpm * std::numbers::pi * diameter / 1000.0;
  speed.below_material = rpm_of(material.min_surface_speed_m_min) > machine.max_spindle_rpm;
  return speed;
}

namespace {

/// Highest speed of each move of the path under acceleration, mm/min.
std::vector<double> reached_mm_min(const Toolpath& path, const Machine& machine,
                                   const PathControl& control) {
  std::vector<double> reached(path.moves.size(), 0.0);
  std::size_t at = 0;
  MotionTimer timer(machine, control, [&](const PlannedPiece& p) {
    for (std::uint32_t i = 0; i < p.piece.moves_ended && at < reached.size(); ++i)
      reached[at++] = 60.0 * p.top_mm_s;
  });
  ToolPosition from = path.start;
  for (const PathMove& m : path.moves) {
    timer.add(motion_of(from, m));
    from = m.to;
  }
  timer.rest();
  return reached;
}

/// Largest share of the path's direction that points down.
double steepest_down(const Motion& motion, const MoveLimits& limits) {
  double down = std::fmax(-limits.start.z, -limits.end.z);
  if (motion.kind != Motion::Kind::arc || motion.plane == ArcPlane::xy) return down;
  // Turned by b, the tangent is cos(b) t + sin(b) n, with n towards the centre.
  const Vec3 n = normalized(motion.centre_mm - motion.from_mm), t = limits.start;
  double turn = std::atan2(-n.z, -t.z);
  if (turn < 0.0) turn += 2.0 * std::numbers::pi;
  if (turn <= std::fabs(motion.sweep_rad)) down = std::hypot(n.z, t.z);
  return down;
}

/// Keeps the feed of the move before where it is as good.
double chosen(double allowed, double before) {
  return before <= allowed && before >= (1.0 - kKeepWithin) * allowed ? before : rounded(allowed);
}

}  // namespace

Result<FeedReport> set_feeds(Toolpath& path, const Machine& machine, const Material& material,
                             const Tool& tool, std::span<const Engagement> engagement,
                             const FeedOptions& options) {
  const std::size_t n = path.moves.size();
  MAQUETTE_CHECK(engagement.size() == 1 || engagement.size() == n, "{} engagements for {} moves",
                 engagement.size(), n);
  MAQUETTE_CHECK(options.cusp_mm > 0.0, "cusp of {} mm", options.cusp_mm);
  double deepest = 0.0;
  for (const Engagement& e : engagement) deepest = std::fmax(deepest, e.depth_mm);
  FeedReport report;
  report.spindle_rpm = options.spindle_rpm;
  if (report.spindle_rpm == 0.0) {
    MAQUETTE_TRY(const SpindleSpeed speed, spindle_speed(machine, material, tool, deepest));
    report.spindle_rpm = speed.rpm;
  }

  enum class By : std::uint8_t { chip, axes, plunge, acceleration };
  std::vector<By> by(n, By::chip);
  ToolPosition from = path.start;
  for (std::size_t i = 0; i < n; ++i) {
    PathMove& move = path.moves[i];
    const ToolPosition begin = from;
    from = move.to;
    if (move.kind == PathMove::Kind::rapid) continue;
    const Engagement e = engagement.size() == 1 ? engagement[0] : engagement[i];
    double feed = report.spindle_rpm * tool.teeth *
                  feed_per_tooth_mm(material, tool.cutter, e, options.cusp_mm);
    const double plunge = std::fmin(machine.max_plunge_mm_min, material.plunge_share * feed);
    move.feed_mm_min = feed;
    const Motion motion = motion_of(begin, move);
    if (move.kind == PathMove::Kind::line && begin == move.to) continue;
    const MoveLimits limits = move_limits(machine, motion);
    if (const double axes = 60.0 * limits.axis_speed_mm_s; axes < feed) {
      feed = axes;
      by[i] = By::axes;
    }
    if (const double down = steepest_down(motion, limits); down * feed > plunge) {
      feed = plunge / down;
      by[i] = By::plunge;
    }
    move.feed_mm_min = feed;
  }
  const std::vector<double> reached = reached_mm_min(path, machine, options.control);
  double before = 0.0;
  for (std::size_t i = 0; i < n; ++i) {
    PathMove& move = path.moves[i];
    if (move.kind == PathMove::Kind::rapid) continue;
    double feed = 0.0;
    if (reached[i] > 0.0 && reached[i] < (1.0 - kKeepWithin) * move.feed_mm_min) {
      const double most = std::fmin(move.feed_mm_min, kNamedWithin * reached[i]);
      feed = before >= reached[i] && before <= most
                 ? before
                 : rounded(std::fmin(most, std::sqrt(kNamedWithin) * reached[i]));
      by[i] = By::acceleration;
    } else {
      feed = chosen(move.feed_mm_min, before);
    }
    report.changes += feed != before;
    move.feed_mm_min = before = feed;
    report.lowest_mm_min = report.moves == 0 ? feed : std::fmin(report.lowest_mm_min, feed);
    report.highest_mm_min = std::fmax(report.highest_mm_min, feed);
    ++report.moves;
    switch (by[i]) {
      case By::chip:
        ++report.by_chip;
        break;
      case By::axes:
        ++report.by_axes;
        break;
      case By::plunge:
        ++report.by_plunge;
        break;
      case By::acceleration:
        ++report.by_acceleration;
        break;
    }
  }
  return report;
}

void limit_feeds(Toolpath& path, const Machine& machine) {
  ToolPosition from = path.start;
  double before = 0.0;
  for (PathMove& move : path.moves) {
    const ToolPosition begin = from;
    from = move.to;
    if (move.kind == PathMove::Kind::rapid) continue;
    if (move.kind == PathMove::Kind::line && begin == move.to) continue;
    const Motion motion = motion_of(begin, move);
    const MoveLimits limits = move_limits(machine, motion);
    double allowed = std::fmin(move.feed_mm_min, 60.0 * limits.axis_speed_mm_s);
    if (const double down = steepest_down(motion, limits);
        down * allowed > machine.max_plunge_mm_min)
      allowed = machine.max_plunge_mm_min / down;
    // What is within the limits stays as it is, to the last digit.
    if (allowed < move.feed_mm_min) move.feed_mm_min = chosen(allowed, before);
    before = move.feed_mm_min;
  }
}

}  // namespace maquette::cnc
