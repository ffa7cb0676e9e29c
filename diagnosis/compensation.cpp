// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/compensation.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <oneapi/tbb/parallel_for.h>
#include <Eigen/Dense>

#include "diagnosis/detail/forms.hpp"
#include "diagnosis/extended_model.hpp"
#include "heightmap/field_io.hpp"

namespace maquette::diagnosis {
namespace {

constexpr int kTable = 33;  // stops of a straightness table
constexpr double kMostNodes = 300.0;

double& axis_of(Vec3& v, char axis) {
  return axis == 'x' ? v.x : axis == 'y' ? v.y : v.z;
}

/// The curve that was fitted, at even stops.
std::vector<cnc::MachineErrors::Straightness> tables(const Cause& cause, const Scene& scene) {
  const auto terms = restore({as_known(cause)}, scene, {});
  std::vector<cnc::MachineErrors::Straightness> all;
  if (!terms) return all;
  const int along = cause.effect.back() == 'x' ? 0 : 1;
  for (const int moves : {2, 1 - along}) {
    cnc::MachineErrors::Straightness s{along, moves, {}, {}};
    double largest = 0.0;
    for (int i = 0; i < kTable; ++i) {
      Observation o;
      const double share = static_cast<double>(i) / (kTable - 1);
      o.tip = scene.box.min + share * (scene.box.max - scene.box.min);
      o.along = moves == 2 ? Vec3{0, 0, 1} : moves == 1 ? Vec3{0, 1, 0} : Vec3{1, 0, 0};
      double sum = 0.0;
      for (const KnownTerm& t : *terms) sum += t.coefficient * t.value(o);
      s.position_mm.push_back(along == 0 ? o.tip.x : o.tip.y);
      s.error_mm.push_back(sum);
      largest = std::fmax(largest, std::abs(sum));
    }
    if (largest > 0.0) all.push_back(std::move(s));
  }
  return all;
}

std::string number(double v) {
  const std::string text = fmt::format("{:.9g}", v);
  return text.find_first_of(".en") == std::string::npos ? text + ".0" : text;
}

std::string numbers(const std::vector<double>& v) {
  std::string text;
  for (const double x : v) text += (text.empty() ? "" : ", ") + number(x);
  return "[" + text + "]";
}

}  // namespace

Compensation compensation_of(const Diagnosis& d, const Scene& scene) {
  Compensation c;
  cnc::MachineErrors& e = c.errors;
  e.exact_at_mm = scene.centre();
  for (const Cause& cause : d.causes) {
    const std::string& name = cause.effect;
    const auto is = [&](const char* family) { return name.starts_with(family); };
    const char axis = name.empty() ? ' ' : name.back();
    if (!is("machine.scale_") && !is("machine.squareness_") && !is("machine.straightness_") &&
        !is("machine.backlash_") && name != "tool.radius_error" && name != "tool.length_offset") {
      const Effect* effect = find_effect(name);
      c.left.emplace_back(name, effect != nullptr && !effect->correction.empty()
                                    ? "no program makes it good: " + effect->correction
                                    : "no program makes it good");
      continue;
    }
    if (!cause.equivalent.empty()) {
      c.left.emplace_back(name, fmt::format("not told from {}; first: {}",
                                            fmt::join(cause.equivalent, ", "), cause.separate_by));
      continue;
    }
    const double value = cause.parameters.empty() ? 0.0 : cause.parameters[0].value;
    if (!cause.fixed.empty() && cause.fixed[0].first == detail::kOvercompensatedWidth) {
      c.left.emplace_back(name,
                          fmt::format("the control's own backlash compensation is too large by "
                                      "{:.3g} mm: set it lower there",
                                      value));
      continue;
    }
    if (is("machine.scale_")) axis_of(e.scale_um_per_m, axis) = value;
    if (name == "machine.squareness_xy") e.squareness_xy_urad += value;
    if (name == "machine.squareness_xz") e.squareness_xz_urad = value;
    if (name == "machine.squareness_yz") e.squareness_yz_urad = value;
    if (is("machine.backlash_")) axis_of(e.backlash_mm, axis) = value;
    for (const Estimate& p : cause.parameters)
      if (p.name == "slope_urad") e.squareness_xy_urad += p.value;
    if (is("machine.straightness_"))
      for (auto& table : tables(cause, scene)) e.straightness.push_back(std::move(table));
    if (name == "tool.radius_error") e.radius_error_mm = value;
    if (name == "tool.length_offset") e.length_offset_mm = value;
    c.used.push_back(name);
  }
  return c;
}

std::string compensation_toml(const Diagnosis& d, const Scene& scene) {
  const Compensation c = compensation_of(d, scene);
  const cnc::MachineErrors& e = c.errors;
  if (c.used.empty()) return "";
  std::string text =
      "# What machine and tool do otherwise than they are called to, as the diagnosis has found.\n"
      "# For the tables of the control, or: maquette compensate part.ngc --by compensation.toml\n"
      "schema = \"maquette.compensation/1\"\n";
  for (const auto& [cause, why] : c.left) text += fmt::format("# left: {}: {}\n", cause, why);
  text += fmt::format("exact_at_mm = {}  # where scale and squareness displace nothing\n",
                      numbers({e.exact_at_mm.x, e.exact_at_mm.y, e.exact_at_mm.z}));
  const auto key = [&](const char* name, double v, const char* says) {
    if (v != 0.0) text += fmt::format("{} = {}  # {}\n", name, number(v), says);
  };
  text += "\n[machine]\n";
  key("scale_x_um_per_m", e.scale_um_per_m.x, "> 0: travels too far");
  key("scale_y_um_per_m", e.scale_um_per_m.y, "> 0: travels too far");
  key("scale_z_um_per_m", e.scale_um_per_m.z, "> 0: travels too far");
  key("squareness_xy_urad", e.squareness_xy_urad, "x goes along with y");
  key("squareness_xz_urad", e.squareness_xz_urad, "x goes along with z");
  key("squareness_yz_urad", e.squareness_yz_urad, "y goes along with z");
  key("backlash_x_mm", e.backlash_mm.x, "lost motion");
  key("backlash_y_mm", e.backlash_mm.y, "lost motion");
  key("backlash_z_mm", e.backlash_mm.z, "lost motion");
  text += "\n[tool]\n";
  key("radius_error_mm", e.radius_error_mm, "larger than programmed");
  key("length_offset_mm", e.length_offset_mm, "its tip stands higher than called");
  constexpr const char* kAxes[3] = {"x", "y", "z"};
  for (const auto& s : e.straightness)
    text += fmt::format(
        "\n[[straightness]]\nalong = \"{}\"\nmoves = \"{}\"\nposition_mm = {}\nerror_mm = {}\n",
        kAxes[s.along], kAxes[s.moves], numbers(s.position_mm), numbers(s.error_mm));
  return text;
}

Result<Improvement> improvement(const CaseInput& extended,
                                const std::vector<std::filesystem::path>& rewritten,
                                const RunContext& run) {
  CaseInput meant = extended, after = extended;
  meant.known.clear();
  after.programs = rewritten;
  MAQUETTE_TRY(const auto design, heightmap::read_model_field(extended.design));
  const double wide = design.x_mm(design.z_mm.cols() - 1) - design.x0.value(),
               high = design.y_mm(design.z_mm.rows() - 1) - design.y0.value();
  const double step = std::fmax(design.spacing.value(), std::fmax(wide, high) / kMostNodes);
  const auto cols = static_cast<std::size_t>(wide / step) - 1,
             rows = static_cast<std::size_t>(high / step) - 1;
  // One model at a time: each holds a program.
  std::vector<std::optional<Observation>> target(rows * cols);
  std::vector<double> height[2];
  const auto each = [&](const auto& visit) {
    oneapi::tbb::parallel_for(std::size_t{0}, rows, [&](std::size_t r) {
      for (std::size_t c = 0; c < cols; ++c)
        visit(r * cols + c, design.x0.value() + step * static_cast<double>(c + 1),
              design.y0.value() + step * static_cast<double>(r + 1));
    });
  };
  {
    MAQUETTE_TRY(const auto model, ExtendedModel::make(meant, run));
    each([&](std::size_t i, double x, double y) {
      target[i] = model.place(x, y);
      if (target[i]) target[i]->rivals.reset();
    });
  }
  for (std::size_t k = 0; k < 2; ++k) {
    MAQUETTE_TRY(const auto model, ExtendedModel::make(k == 0 ? extended : after, run));
    height[k].assign(target.size(), NAN);
    each([&](std::size_t i, double x, double y) {
      if (const auto z = model.height_mm(x, y)) height[k][i] = *z;
    });
  }
  Improvement result;
  const Vec3 centre{design.x0.value() + 0.5 * wide, design.y0.value() + 0.5 * high, 0.0};
  for (std::size_t k = 0; k < 2; ++k) {
    using Vector = Eigen::Matrix<double, 6, 1>;
    Eigen::Matrix<double, 6, 6> a = Eigen::Matrix<double, 6, 6>::Zero();
    Vector b = Vector::Zero();
    const auto visit = [&](const auto& use) {
      for (std::size_t i = 0; i < target.size(); ++i) {
        if (!target[i] || std::isnan(height[0][i]) || std::isnan(height[1][i])) continue;
        const Observation& o = *target[i];
        const double meant_z = o.place.z + o.residual_mm / o.normal.z;
        const Vec3 turn = (2.0 / std::fmax(wide, high)) * cross(o.place - centre, o.normal);
        Vector j;
        j << o.normal.x, o.normal.y, o.normal.z, turn.x, turn.y, turn.z;
        use(j, (height[k][i] - meant_z) * o.normal.z);
      }
    };
    visit([&](const Vector& j, double e) {
      a += j * j.transpose();
      b += j * e;
    });
    a.diagonal().array() += 1e-9 * a.trace();
    const Vector pose = a.ldlt().solve(b);
    double squares = 0.0, largest = 0.0, n = 0.0;
    visit([&](const Vector& j, double e) {
      const double rest = e - j.dot(pose);
      squares += rest * rest;
      largest = std::fmax(largest, std::abs(rest));
      n += 1.0;
    });
    (k == 0 ? result.rms_before_mm : result.rms_after_mm) = std::sqrt(squares / std::fmax(1.0, n));
    (k == 0 ? result.max_before_mm : result.max_after_mm) = largest;
    result.nodes = static_cast<std::size_t>(n);
  }
  return result;
}

}  // namespace maquette::diagnosis
