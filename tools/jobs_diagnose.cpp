// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include "core/files.hpp"
#include "diagnosis/compensation.hpp"
#include "diagnosis/controls.hpp"
#include "diagnosis/detectability.hpp"
#include "diagnosis/diagnose.hpp"
#include "tools/extended.hpp"
#include "tools/jobs.hpp"

namespace maquette::tools {
namespace {

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

}  // namespace

Result<JobResult> diagnose_job(const fs::path& case_path, const fs::path& folder,
                               std::uint64_t seed, bool require_cause, bool with_controls,
                               const RunContext& run) {
  MAQUETTE_TRY(const auto c, read_case(case_path));
  MAQUETTE_TRY(const auto measurements, diagnosis::measure(diagnosis_input(*c, seed), run));
  MAQUETTE_TRY(auto d, diagnosis::diagnose(measurements, seed, run));
  if (with_controls) {
    MAQUETTE_TRY(d.controls, diagnosis::controls(measurements, d, seed, run));
    if (!d.controls->passed()) d.notes.push_back("a control did not pass: see the report");
  }
  std::error_code ec;
  fs::create_directories(folder, ec);
  if (ec) return tl::unexpected(write_error(folder, ec.value()));
  JobResult result;
  result.outputs = {folder / "diagnosis.json", folder / "extended.toml", folder / "report.html"};
  MAQUETTE_TRY_VOID(write_file(result.outputs[0], diagnosis::to_json(d)));
  MAQUETTE_TRY(std::string text, read_file(case_path));
  text = moved(text, fs::absolute(case_path).parent_path(), folder) + diagnosis::extension_toml(d);
  MAQUETTE_TRY_VOID(write_file(result.outputs[1], text));
  MAQUETTE_TRY_VOID(write_file(result.outputs[2], diagnosis::to_html(d)));
  const fs::path compensation = folder / "compensation.toml";
  fs::remove(compensation, ec);  // of an earlier diagnosis
  if (const auto toml = diagnosis::compensation_toml(d, measurements.scene); !toml.empty()) {
    MAQUETTE_TRY_VOID(write_file(compensation, toml));
    result.outputs.push_back(compensation);
  }
  result.figures_json = diagnosis::to_json(d);
  result.note = d.verdict;
  for (const auto& cause : d.causes) {
    result.note += fmt::format("; {}", cause.effect);
    for (const auto& p : cause.parameters)
      result.note += fmt::format(" {} {:.4g}", p.name, p.value);
  }
  result.note +=
      fmt::format("; {:.4f} mm rms before, {:.4f} after", d.rms_before_mm, d.rms_after_mm);
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
