// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/jobs_expose.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <nlohmann/json.hpp>

#include "camera/image_io.hpp"
#include "core/files.hpp"
#include "core/markup.hpp"
#include "core/nearest_name.hpp"
#include "tools/camera_file.hpp"
#include "tools/jobs.hpp"
#include "tools/pictures.hpp"
#include "tools/rendered_light.hpp"
#include "tools/version.hpp"

namespace maquette::tools {
namespace {

constexpr const char* kMasksEnding = ".masks.exr";

/// @param light  a grey sensor's picture of three bands becomes one where radiances are known
Result<CameraFile> camera_of(const ExposeJob& job, RenderedLight& light) {
  MAQUETTE_TRY(CameraFile file, read_camera(job.camera, job.set));
  const auto names = camera::effect_names();
  const auto leave_out = [&file](std::string_view effect) {
    std::erase_if(file.stack,
                  [&](const camera::Effect& e) { return camera::info(e).name == effect; });
  };
  for (const std::string& effect : job.without) {
    if (std::find(names.begin(), names.end(), effect) == names.end())
      return fail(kUnknownName, fmt::format("--without {}: no such effect; there are {}", effect,
                                            fmt::join(names, ", ")));
    leave_out(effect);
  }
  if (has_depth_of_field(light)) leave_out(camera::DepthOfField::kInfo.name);
  MAQUETTE_TRY(const auto time, time_of(light));
  file.shot.time_s = job.time_s ? *job.time_s : time.value_or(0.0);
  file.shot.seed = job.seed;
  MAQUETTE_TRY_VOID(take_radiance(light, file));
  MAQUETTE_TRY_VOID(take_motion(light, file.shot));
  if (job.fit_sensor) {
    // The same angle across, in as many pixels as the picture has.
    camera::Intrinsics& k = file.shot.intrinsics;
    const Grid<float>& picture = light.frame.bands[0];
    const double ratio = static_cast<double>(picture.cols()) / k.width_px;
    k.width_px = static_cast<int>(picture.cols());
    k.height_px = static_cast<int>(picture.rows());
    k.fx_px *= ratio, k.fy_px *= ratio, k.skew_px *= ratio;
    k.cx_px = 0.5 * k.width_px, k.cy_px = 0.5 * k.height_px;
    file.shot.pixel_pitch_um /= ratio;
  }
  MAQUETTE_TRY_VOID(camera::check(file.stack, file.shot));
  return file;
}

const char* unit_of(camera::Signal signal) {
  switch (signal) {
    case camera::Signal::dn:
      return "DN";
    case camera::Signal::electrons:
      return "electrons";
    case camera::Signal::photons:
      return "photons";
    default:
      return "1";
  }
}

/// What the rendering's file says, and what makes this picture of it.
Result<camera::Metadata> metadata_of(const ExposeJob& job, const camera::Metadata& rendered,
                                     const camera::Shot& shot, const camera::Frame& picture) {
  MAQUETTE_TRY(const std::string camera_text, camera_file_text(job.camera));
  MAQUETTE_TRY(const std::string digest, sha256_file(job.image));
  camera::Metadata all = rendered;
  for (auto& [key, value] :
       camera::Metadata{{"maquette:camera", camera_text},
                        {"maquette:set", fmt::format("{}", fmt::join(job.set, "\n"))},
                        {"maquette:without", fmt::format("{}", fmt::join(job.without, ","))},
                        {"maquette:fit_sensor", job.fit_sensor ? "true" : "false"},
                        {"maquette:noise_seed", fmt::format("{}", job.seed)},
                        {"maquette:noise_time_s", fmt::format("{}", shot.time_s)},
                        {"maquette:expose_version", kVersion},
                        {"maquette:radiance_sha256", digest},
                        {kExposedKey, std::string(camera::name_of(picture.signal))},
                        {"maquette:unit", unit_of(picture.signal)}}) {
    std::erase_if(all, [&](const auto& entry) { return entry.first == key; });
    all.emplace_back(std::move(key), std::move(value));
  }
  return all;
}

using Channels = std::vector<std::pair<std::string, const Grid<float>*>>;

/// Z and lit, where they are known.
Channels masks_of(const camera::Frame& picture) {
  Channels channels;
  if (!picture.depth_mm.empty()) channels.emplace_back("Z", &picture.depth_mm);
  if (!picture.lit.empty()) channels.emplace_back("lit", &picture.lit);
  return channels;
}

Grid<camera::Rgb8> bytes_of(const camera::Frame& f) {
  Grid<camera::Rgb8> bytes(f.bands[0].rows(), f.bands[0].cols());
  for (std::size_t b = 0; b < 3; ++b) {
    const auto from = f.bands[f.bands.size() == 3 ? b : 0].cells();
    for (std::size_t i = 0; i < from.size(); ++i)
      bytes.cells()[i][b] =
          static_cast<std::uint8_t>(255.0F * std::clamp(from[i], 0.0F, 1.0F) + 0.5F);
  }
  return bytes;
}

/// Part of a picture, each pixel `times` as large.
Grid<camera::Rgb8> enlarged(const Grid<camera::Rgb8>& from, std::ptrdiff_t rows,
                            std::ptrdiff_t cols, std::ptrdiff_t top, std::ptrdiff_t left,
                            std::ptrdiff_t times) {
  Grid<camera::Rgb8> to(rows * times, cols * times);
  for (std::ptrdiff_t r = 0; r < to.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < to.cols(); ++c)
      to(r, c) = from(top + r / times, left + c / times);
  return to;
}

Grid<camera::Rgb8> reduced(const Grid<camera::Rgb8>& from, std::ptrdiff_t width) {
  const std::ptrdiff_t step = std::max<std::ptrdiff_t>(1, (from.cols() + width - 1) / width);
  Grid<camera::Rgb8> to(std::max<std::ptrdiff_t>(1, from.rows() / step),
                        std::max<std::ptrdiff_t>(1, from.cols() / step));
  for (std::ptrdiff_t r = 0; r < to.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < to.cols(); ++c) {
      std::array<int, 3> sum{};
      for (std::ptrdiff_t i = 0; i < step; ++i)
        for (std::ptrdiff_t j = 0; j < step; ++j)
          for (std::size_t b = 0; b < 3; ++b)
            if (from.contains(r * step + i, c * step + j))
              sum[b] += from(r * step + i, c * step + j)[b];
      for (std::size_t b = 0; b < 3; ++b)
        to(r, c)[b] = static_cast<std::uint8_t>(sum[b] / static_cast<int>(step * step));
    }
  return to;
}

/// 128 and eight times what an effect changes.
Grid<camera::Rgb8> eightfold(const camera::Frame& a, const camera::Frame& b) {
  camera::Frame d = a;
  for (std::size_t k = 0; k < d.bands.size(); ++k)
    for (std::size_t i = 0; i < d.bands[k].cells().size(); ++i)
      d.bands[k].cells()[i] = 0.5F + 8.0F * (a.bands[k].cells()[i] - b.bands[k].cells()[i]);
  return bytes_of(d);
}

std::string picture_html(const Grid<camera::Rgb8>& picture) {
  return fmt::format("<img src=\"data:image/png;base64,{}\">", base64(camera::encode_png(picture)));
}

/// The effects without which there is no picture.
bool is_base(std::string_view name) {
  for (const auto* base : {"exposure", "quantum_efficiency", "adc", "white_balance", "tone"})
    if (name == base) return true;
  return false;
}

/// The file's stack reduced to the base and `one` (with what it cannot be without).
camera::Stack alone(const camera::Stack& all, std::string_view one) {
  camera::Stack stack;
  for (const camera::Effect& e : all) {
    const auto name = camera::info(e).name;
    if (is_base(name) || name == one || (one == "bayer" && name == "demosaic")) stack.push_back(e);
  }
  return stack;
}

std::string sheet_row(const std::string& title, const std::string& text,
                      const camera::Frame& picture, const camera::Frame& plain) {
  constexpr std::ptrdiff_t kTimes = 4, kCropRows = 60, kCropCols = 80, kWidth = 400;
  const Grid<camera::Rgb8> bytes = bytes_of(picture);
  const auto rows = std::min(kCropRows, bytes.rows()), cols = std::min(kCropCols, bytes.cols());
  const auto top = (bytes.rows() - rows) / 2, left = (bytes.cols() - cols) / 2;
  return fmt::format("<tr><td><b>{}</b><br>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>\n",
                     markup_escaped(title), text, picture_html(reduced(bytes, kWidth)),
                     picture_html(enlarged(bytes, rows, cols, top, left, kTimes)),
                     picture_html(reduced(eightfold(picture, plain), kWidth)));
}

double change_255(const camera::Frame& a, const camera::Frame& b) {
  double sum = 0.0;
  std::size_t n = 0;
  for (std::size_t k = 0; k < a.bands.size(); ++k)
    for (std::size_t i = 0; i < a.bands[k].cells().size(); ++i, ++n)
      sum += std::abs(static_cast<double>(a.bands[k].cells()[i]) -
                      static_cast<double>(b.bands[k].cells()[i]));
  return 255.0 * sum / static_cast<double>(n);
}

}  // namespace

Result<JobResult> expose_job(const ExposeJob& job, const fs::path& out, const RunContext& run) {
  MAQUETTE_TRY(RenderedLight light, read_rendered_light(job.image));
  const auto within = [&](Error error) {
    return tl::unexpected(std::move(error).within(job.image.string()));
  };
  auto file = camera_of(job, light);
  if (!file) return within(std::move(file.error()));
  const bool through_lens = has_depth_of_field(light);
  auto picture = camera::expose(file->stack, file->shot, std::move(light.frame), run);
  if (!picture) return within(std::move(picture.error()));
  MAQUETTE_TRY(const camera::Metadata metadata,
               metadata_of(job, light.metadata, file->shot, *picture));
  Channels bands;
  for (std::size_t b = 0; b < picture->bands.size(); ++b)
    bands.emplace_back(picture->bands.size() == 1 ? "Y" : std::string(1, "RGB"[b]),
                       &picture->bands[b]);
  const Channels masks = masks_of(*picture);
  JobResult result;
  result.outputs = {out};
  if (out.extension() == ".exr") {
    Channels all = bands;
    all.insert(all.end(), masks.begin(), masks.end());
    MAQUETTE_TRY_VOID(camera::write_exr(all, out, metadata));
  } else {
    const double white =
        picture->signal == camera::Signal::dn ? camera::largest_dn(file->shot) : 1.0;
    if (picture->signal != camera::Signal::dn && picture->signal != camera::Signal::linear &&
        picture->signal != camera::Signal::display)
      return fail(camera::kImageFormat,
                  fmt::format("{}: the stack ends with {}, which only .exr holds", out.string(),
                              camera::name_of(picture->signal)));
    MAQUETTE_TRY_VOID(camera::write_whole_numbers(
        bands, white, picture->signal == camera::Signal::display ? 8 : 16, out, metadata));
  }
  if (job.masks) {
    if (masks.empty())
      return fail(camera::kFrame, fmt::format("{}: neither depth (Z) nor lit is in it: there are "
                                              "no masks to be written",
                                              job.image.string()));
    result.outputs.push_back(fs::path(out).replace_extension(kMasksEnding));
    MAQUETTE_TRY_VOID(camera::write_exr(masks, result.outputs.back(), metadata));
  }
  nlohmann::json figures{{"width_px", picture->bands[0].cols()},
                         {"height_px", picture->bands[0].rows()},
                         {"bands", picture->bands.size()},
                         {"time_s", file->shot.time_s},
                         {"depth_of_field_as_rendered", through_lens},
                         {"signal", std::string(camera::name_of(picture->signal))}};
  figures["mean"] = nlohmann::json::array();
  for (const auto& [name, grid] : bands) {
    double sum = 0.0;
    for (const float v : grid->cells()) sum += static_cast<double>(v);
    figures["mean"].push_back(sum / static_cast<double>(grid->cells().size()));
  }
  result.figures_json = figures.dump();
  result.note = fmt::format("{} x {} pixels through {} effects of {}", picture->bands[0].cols(),
                            picture->bands[0].rows(), file->stack.size(), file->name);
  if (through_lens) result.note += "; depth of field as rendered";
  return result;
}

Result<std::vector<fs::path>> pictures_in(const std::vector<fs::path>& images_or_folders) {
  // picture_2 comes before picture_10: runs of digits by their value.
  const auto before = [](const fs::path& a, const fs::path& b) {
    const std::string x = a.filename().string(), y = b.filename().string();
    const auto digit = [](char c) { return c >= '0' && c <= '9'; };
    std::size_t i = 0, j = 0;
    while (i < x.size() && j < y.size()) {
      if (!digit(x[i]) || !digit(y[j])) {
        if (x[i] != y[j]) return x[i] < y[j];
        ++i, ++j;
        continue;
      }
      const auto number = [&](const std::string& text, std::size_t& at) {
        while (at + 1 < text.size() && text[at] == '0' && digit(text[at + 1])) ++at;
        const std::size_t first = at;
        while (at < text.size() && digit(text[at])) ++at;
        return text.substr(first, at - first);
      };
      const std::string m = number(x, i), n = number(y, j);
      if (m.size() != n.size()) return m.size() < n.size();
      if (m != n) return m < n;
    }
    return x.size() - i != y.size() - j ? x.size() - i < y.size() - j : x < y;
  };
  std::vector<fs::path> pictures;
  for (const fs::path& given : images_or_folders) {
    std::error_code ec;
    if (!fs::is_directory(given, ec)) {
      pictures.push_back(given);
      continue;
    }
    std::vector<fs::path> found;
    for (fs::directory_iterator at(given, ec), end; !ec && at != end; at.increment(ec))
      if (at->path().extension() == ".exr" &&
          !at->path().filename().string().ends_with(kMasksEnding))
        found.push_back(at->path());
    if (found.empty())
      return fail(kInputMissing,
                  fmt::format("{}: no .exr in this folder to be exposed", given.string()));
    std::sort(found.begin(), found.end(), before);
    pictures.insert(pictures.end(), found.begin(), found.end());
  }
  return pictures;
}

Result<JobResult> expose_sequence_job(const ExposeJob& job, const std::vector<fs::path>& images,
                                      const fs::path& out, const RunContext& run) {
  std::error_code ec;
  if (!out.parent_path().empty()) fs::create_directories(out.parent_path(), ec);
  if (ec) return tl::unexpected(write_error(out.parent_path(), ec.value()));
  std::vector<fs::path> outputs;
  for (std::size_t i = 0; i < images.size(); ++i) {
    outputs.push_back(out.parent_path() / fmt::format("{}_{:04}{}", out.stem().string(), i + 1,
                                                      out.extension().string()));
    for (const fs::path& image : images)
      if (fs::equivalent(outputs.back(), image, ec))
        return fail(kUnknownFormat, fmt::format("{} would be written over: give --out another name",
                                                image.string()));
  }
  const auto start = std::chrono::steady_clock::now();
  JobResult result;
  nlohmann::json list = nlohmann::json::array();
  for (std::size_t i = 0; i < images.size(); ++i) {
    ExposeJob one = job;
    one.image = images[i];
    RunContext part = run;
    part.progress = [&](double share) {
      run.progress((static_cast<double>(i) + share) / static_cast<double>(images.size()));
    };
    MAQUETTE_TRY(JobResult done, expose_job(one, outputs[i], part));
    auto figures = nlohmann::json::parse(done.figures_json);
    figures["image"] = images[i].filename().string();
    list.push_back(std::move(figures));
    result.outputs.insert(result.outputs.end(), done.outputs.begin(), done.outputs.end());
    result.note = std::move(done.note);
  }
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - start;
  result.figures_json =
      nlohmann::json{{"pictures", images.size()}, {"frames", std::move(list)}}.dump();
  result.note = fmt::format("{} pictures of {}, {:.2g} a second", images.size(), result.note,
                            static_cast<double>(images.size()) / std::max(took.count(), 1e-9));
  return result;
}

Result<JobResult> stack_job(const ExposeJob& job, const fs::path& folder, const RunContext& run) {
  MAQUETTE_TRY(RenderedLight rendered, read_rendered_light(job.image));
  MAQUETTE_TRY(const CameraFile file, camera_of(job, rendered));
  const camera::Frame& light = rendered.frame;
  MAQUETTE_TRY(const auto list, camera::swaps(file.stack, file.shot, light, run));
  MAQUETTE_TRY(const camera::Frame plain, camera::expose(alone(file.stack, ""), file.shot, light));
  nlohmann::ordered_json json{{"schema", "maquette.stack/1"}, {"camera", file.name}};
  std::string rows = sheet_row("light alone",
                               "exposure, quantum efficiency, converter, white "
                               "balance and tone curve without noise",
                               plain, plain);
  for (const camera::Effect& e : file.stack) {
    const camera::EffectInfo& i = camera::info(e);
    nlohmann::ordered_json entry{{"effect", i.name},
                                 {"takes", camera::name_of(i.takes)},
                                 {"gives", camera::name_of(i.gives)},
                                 {"why_here", i.why}};
    if (!is_base(i.name) && i.name != "demosaic") {
      MAQUETTE_TRY(const camera::Frame one, camera::expose(alone(file.stack, i.name), file.shot,
                                                           light, RunContext{run.stop}));
      const double change = change_255(one, plain);
      entry["alone_255"] = change;
      rows += sheet_row(std::string(i.name),
                        fmt::format("changes {:.3f}/255. It acts here because {}.", change,
                                    markup_escaped(std::string(i.why))),
                        one, plain);
    }
    json["effects"].push_back(std::move(entry));
  }
  MAQUETTE_TRY(const camera::Frame whole, camera::expose(file.stack, file.shot, light));
  rows +=
      sheet_row("all together", fmt::format("{:.3f}/255", change_255(whole, plain)), whole, plain);
  std::string swap_rows, fixed_rows;
  std::size_t possible = 0;
  json["swaps"] = json["not_swappable"] = nlohmann::ordered_json::array();
  for (const camera::Swap& s : list) {
    if (!s.impossible.empty()) {
      json["not_swappable"].push_back(
          {{"first", s.first}, {"second", s.second}, {"because", s.impossible}});
      fixed_rows += fmt::format("<tr><td>{}</td><td>{}</td><td>{}</td></tr>\n", s.first, s.second,
                                markup_escaped(s.impossible));
      continue;
    }
    ++possible;
    json["swaps"].push_back({{"first", s.first},
                             {"second", s.second},
                             {"mean_abs_255", s.mean_abs_255},
                             {"max_abs_255", s.max_abs_255}});
    swap_rows += fmt::format(
        "<tr><td>{}</td><td>{}</td><td align=right>{:.4f}</td><td align=right>"
        "{:.2f}</td></tr>\n",
        s.first, s.second, s.mean_abs_255, s.max_abs_255);
  }
  const std::string page = fmt::format(
      "<!doctype html><meta charset=utf-8><title>{0}</title><style>body{{font:14px sans-serif;"
      "margin:1em}}td{{vertical-align:top;padding:4px 8px;max-width:420px}}img{{display:block}}"
      "th{{text-align:left}}</style><h1>Effects of {0}</h1><table><tr><th>effect<th>picture<th>its "
      "middle, 4 x<th>128 + 8 x what it changes</tr>\n{1}</table><h2>What another order would "
      "change</h2><table><tr><th>effect<th>in the place of<th>mean x/255<th>most x/255</tr>\n{2}"
      "</table><details><summary>{3} pairs of effects cannot change places</summary><table><tr><th>"
      "effect<th>and<th>because</tr>\n{4}</table></details>\n",
      markup_escaped(file.name), rows, swap_rows, list.size() - possible, fixed_rows);
  std::error_code ec;
  fs::create_directories(folder, ec);
  if (ec) return tl::unexpected(write_error(folder, ec.value()));
  JobResult result;
  result.outputs = {folder / "stack.json", folder / "stack.html"};
  result.figures_json = json.dump(1);
  MAQUETTE_TRY_VOID(write_file(result.outputs[0], result.figures_json + "\n"));
  MAQUETTE_TRY_VOID(write_file(result.outputs[1], page));
  result.note = fmt::format("{} effects, {} swaps", file.stack.size(), possible);
  return result;
}

}  // namespace maquette::tools
