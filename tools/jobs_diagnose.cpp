// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "core/files.hpp"
#include "diagnosis/compensation.hpp"
#include "diagnosis/controls.hpp"
#include "diagnosis/detectability.hpp"
#include "diagnosis/diagnose.hpp"
#include "diagnosis/photographs.hpp"
#include "heightmap/field_io.hpp"
#include "tools/extended.hpp"
#include "tools/jobs.hpp"

namespace maquette::tools {
namespace {

constexpr double kEvenLunarLambert = 0.5;
/// Of 45 degrees: what a surface sends on of the light that comes from around it.
constexpr double kMiddleCosine = 0.70710678;

/// The case file's text with the names of files that lie beside it written so that they are found
/// from another folder.
std::string moved(const std::string& text, const fs::path& from, const fs::path& to) {
  std::string out;
  std::size_t at = 0;
  while (at < text.size()) {
    const std::size_t open = text.find('"', at);
    const std::size_t close = open == std::string::npos ? open : text.find('"', open + 1);
    if (close == std::string::npos) break;
    const std::string name = text.substr(open + 1, close - open - 1);
    std::error_code ec;
    const bool file = !name.empty() && name.find('\n') == std::string::npos &&
                      fs::path(name).is_relative() && fs::is_regular_file(from / name, ec);
    out += text.substr(at, open + 1 - at);
    out +=
        file ? fs::proximate(fs::absolute(from / name), fs::absolute(to)).generic_string() : name;
    out += '"';
    at = close + 1;
  }
  return out + text.substr(std::min(at, text.size()));
}

/// How the surface of a photograph sends light back, where that is not Lambert's law. What a colour
/// is of is told from the numbers of a picture: the surface is grey.
Result<std::optional<camera::Law>> law_of(const Case& c, const CasePhoto& p) {
  if (p.material.empty() && p.reflectance == "lambert") return std::nullopt;
  if (p.material.empty())
    return std::optional(law_by_name(p.reflectance, p.albedo, kEvenLunarLambert));
  const auto found = find_material(c.materials, p.material);
  if (!found)
    return fail(found.error().code, fmt::format("{}: {}", p.image.string(), found.error().message));
  const camera::Material& material = *found;
  const auto grey = [&](const camera::Angles& a) {
    const camera::Bands b = camera::radiance_factor(material.law, a);
    return b[0] == b[1] && b[1] == b[2];
  };
  if (material.map || !grey({1.0, 0.8, 0.8}) || !grey({0.5, 0.8, 0.8}))
    return fail(
        kConfigInvalid,
        fmt::format("{}: material \"{}\" has a colour or a map; a diagnosis looks for these: "
                    "give it one value for all bands, and no albedo_map",
                    p.image.string(), p.material));
  return std::optional(material.law);
}

Result<std::vector<diagnosis::PhotoInput>> photographs_of(const Case& c) {
  std::vector<diagnosis::PhotoInput> all;
  for (const CasePhoto& p : c.photos) {
    diagnosis::PhotoInput& o = all.emplace_back();
    o.image = p.image;
    o.srgb = p.encoding == "srgb";
    o.width_px = static_cast<int>(p.resolution_px.at(0));
    o.height_px = static_cast<int>(p.resolution_px.at(1));
    if (p.principal_point_px.size() == 2) {
      o.principal_u_px = p.principal_point_px[0];
      o.principal_v_px = p.principal_point_px[1];
    }
    o.pixel_pitch_um = p.pixel_pitch_um;
    o.focal_length_mm = p.focal_length_mm;
    o.camera_position_mm = p.camera_position_mm;
    o.model_from_camera = p.camera_quaternion_wxyz;
    o.lamp_position_mm = p.lamp_position_mm;
    o.lamp_target_mm = p.lamp_target_mm;
    o.lamp_diameter_mm = p.lamp_diameter_mm;
    o.lamp_beam_deg = p.lamp_beam_deg;
    o.exposure_scale = p.exposure_scale;
    MAQUETTE_TRY(o.law, law_of(c, p));
    o.albedo = p.material.empty() ? p.albedo : camera::directional_albedo(*o.law, kMiddleCosine)[1];
    o.full_well_e = p.full_well_e;
    o.read_noise_e = p.read_noise_e;
    o.as_milled = p.surface == "as_milled";
    o.held_out = p.held_out;
  }
  return all;
}

Result<std::vector<diagnosis::Body>> bodies_of(const Case& c) {
  std::vector<diagnosis::Body> bodies;
  for (const SceneMesh& o : c.objects) {
    MAQUETTE_TRY(const RigidTransform pose, pose_of(o));
    bodies.push_back({o.mesh, pose, o.scale});
  }
  return bodies;
}

/// What scans and photographs say together: causes of both; one that explains nothing of its own
/// measurements leaves them unexplained.
std::string verdict_of(const std::string& a, const std::string& b) {
  if (a == b) return a;
  if (a == "consistent") return b;
  if (b == "consistent") return a;
  return "partly_explained";
}

/// Scans' diagnosis with the photographs' causes beside its own, and what else they show under
/// "photographs".
std::string together(const diagnosis::Diagnosis& points, const diagnosis::Diagnosis& pictures) {
  auto j = nlohmann::ordered_json::parse(diagnosis::to_json(points));
  const auto p = nlohmann::ordered_json::parse(diagnosis::to_json(pictures));
  for (const auto& cause : p["causes"]) j["causes"].push_back(cause);
  j["verdict"] = verdict_of(points.verdict, pictures.verdict);
  j["photographs"] = p;
  return j.dump(1);
}

/// Mean residuals of the report's map as rasters of the model frame, for `view` and other programs;
/// those after only where a cause was named.
Result<void> write_maps(const diagnosis::Diagnosis& d, const fs::path& folder,
                        const std::string& name, std::vector<fs::path>& outputs) {
  const diagnosis::Map& map = d.map;
  if (map.before.rows() < 2 || map.before.cols() < 2) return {};
  const double half = 0.5 * map.cell_mm;
  const heightmap::ModelField frame{map.before, Millimetres{map.cell_mm},
                                    Millimetres{map.x0_mm + half}, Millimetres{map.y0_mm + half}};
  for (const auto& [when, values] :
       {std::pair{"before", &map.before}, std::pair{"after", &map.after}}) {
    if (values == &map.after && d.causes.empty()) continue;  // nothing was taken off
    outputs.push_back(folder / fmt::format("{}_{}.tif", name, when));
    MAQUETTE_TRY_VOID(heightmap::write_model_grid(*values, frame, d.unit.c_str(), outputs.back()));
  }
  return {};
}

}  // namespace

Result<JobResult> diagnose_job(const fs::path& case_path, const fs::path& folder,
                               std::uint64_t seed, bool require_cause, bool with_controls,
                               const RunContext& run) {
  MAQUETTE_TRY(const auto c, read_case(case_path));
  const diagnosis::CaseInput input = diagnosis_input(*c, seed);
  const bool points = !c->scans.empty() || !c->probes.empty();
  diagnosis::Measurements measurements;
  diagnosis::Diagnosis d, pictures;
  if (points) {
    MAQUETTE_TRY(measurements, diagnosis::measure(input, run));
    MAQUETTE_TRY(d, diagnosis::diagnose(measurements, seed, run));
    if (d.beside_long_beams && measurements.settled_anew) {
      MAQUETTE_TRY(measurements, measurements.settled_anew(run));
    }
    if (with_controls) {
      MAQUETTE_TRY(d.controls, diagnosis::controls(measurements, d, seed, run));
      if (!d.controls->passed()) d.notes.push_back("a control did not pass: see the report");
    }
  }
  const bool with_photographs = !c->photos.empty();
  if (with_photographs) {
    MAQUETTE_TRY(const auto photographs, photographs_of(*c));
    // They show the part as the scans found it.
    diagnosis::CaseInput as_found = input;
    MAQUETTE_TRY(as_found.bodies, bodies_of(*c));
    if (points) as_found.contact = d.contact;
    for (const diagnosis::Cause& cause : d.causes)
      as_found.known.push_back(diagnosis::as_known(cause));
    MAQUETTE_TRY(pictures,
                 diagnosis::diagnose_photographs(as_found, photographs, with_controls, run));
  }
  std::error_code ec;
  fs::create_directories(folder, ec);
  if (ec) return tl::unexpected(write_error(folder, ec.value()));
  JobResult result;
  result.outputs = {folder / "diagnosis.json", folder / "extended.toml", folder / "report.html"};
  if (points && with_photographs) {
    result.outputs.push_back(folder / "photographs.html");
    MAQUETTE_TRY_VOID(write_file(result.outputs.back(), diagnosis::to_html(pictures)));
  }
  for (const char* name : {"residual", "residual_photographs"})
    for (const char* when : {"before", "after"})  // of an earlier diagnosis
      fs::remove(folder / fmt::format("{}_{}.tif", name, when), ec);
  if (points) MAQUETTE_TRY_VOID(write_maps(d, folder, "residual", result.outputs));
  if (with_photographs)
    MAQUETTE_TRY_VOID(write_maps(pictures, folder, "residual_photographs", result.outputs));
  std::string report = diagnosis::to_html(points ? d : pictures);
  const std::string json = points && with_photographs ? together(d, pictures)
                                                      : diagnosis::to_json(points ? d : pictures);
  if (!points) {
    d = std::move(pictures);
  } else if (with_photographs) {
    d.causes.insert(d.causes.end(), pictures.causes.begin(), pictures.causes.end());
    d.verdict = verdict_of(d.verdict, pictures.verdict);
    d.notes.insert(d.notes.end(), pictures.notes.begin(), pictures.notes.end());
  }
  MAQUETTE_TRY_VOID(write_file(result.outputs[0], json));
  MAQUETTE_TRY(std::string text, read_file(case_path));
  text = moved(text, fs::absolute(case_path).parent_path(), folder) + diagnosis::extension_toml(d);
  MAQUETTE_TRY_VOID(write_file(result.outputs[1], text));
  MAQUETTE_TRY_VOID(write_file(result.outputs[2], report));
  const fs::path compensation = folder / "compensation.toml";
  fs::remove(compensation, ec);  // of an earlier diagnosis
  if (const auto toml =
          points ? diagnosis::compensation_toml(d, measurements.scene) : std::string();
      !toml.empty()) {
    MAQUETTE_TRY_VOID(write_file(compensation, toml));
    result.outputs.push_back(compensation);
  }
  result.figures_json = json;
  result.note = d.verdict;
  for (const auto& cause : d.causes) {
    result.note += fmt::format("; {}", cause.effect);
    for (const auto& p : cause.parameters)
      result.note += fmt::format(" {} {:.4g}", p.name, p.value);
  }
  result.note +=
      fmt::format("; {:.4f} {} rms before, {:.4f} after", d.rms_before, d.unit, d.rms_after);
  for (const auto& n : d.notes) run.warn(n);
  if (require_cause && d.causes.empty()) result.unmet = "no cause of the library explains the data";
  return result;
}

Result<JobResult> detectability_job(const fs::path& case_path, const fs::path& folder,
                                    std::uint64_t seed, const RunContext& run) {
  MAQUETTE_TRY(const auto c, read_case(case_path));
  MAQUETTE_TRY(const auto measurements, diagnosis::measure(diagnosis_input(*c, seed), run));
  MAQUETTE_TRY(const auto d, diagnosis::detectability(measurements, seed, run));
  std::error_code ec;
  fs::create_directories(folder, ec);
  if (ec) return tl::unexpected(write_error(folder, ec.value()));
  JobResult result;
  result.outputs = {folder / "detectability.json"};
  MAQUETTE_TRY_VOID(write_file(result.outputs[0], diagnosis::to_json(d)));
  result.figures_json = diagnosis::to_json(d);
  result.note = "smallest size that is found with 90 %:";
  for (const auto& e : d.effects)
    result.note += fmt::format("\n  {:32} {} {:.3g} ({:.4f} mm rms)", e.effect, e.parameter,
                               e.smallest, e.rms_mm);
  if (!d.stations.empty())
    result.note += fmt::format("\nanother station helps most {} ({:.2f} times smaller on average)",
                               d.stations[0].where, d.stations[0].mean_factor);
  for (const auto& n : measurements.notes) run.warn(n);
  return result;
}

}  // namespace maquette::tools
