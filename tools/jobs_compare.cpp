// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/jobs_compare.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "camera/image_io.hpp"
#include "core/files.hpp"
#include "tools/document.hpp"
#include "tools/jobs.hpp"

namespace maquette::tools {
namespace {

Table::Cell number(double v, int digits = 3) {
  return {std::isnan(v) ? "-" : fmt::format("{:.{}f}", v, digits), true};
}

/// As photographs are written: quickly, for differences of noise are noise.
Result<void> write_photograph(const Grid<std::uint8_t>& bytes, const fs::path& path) {
  Grid<float> values(bytes.rows(), bytes.cols());
  std::copy(bytes.cells().begin(), bytes.cells().end(), values.cells().begin());
  constexpr double kWhite = 255.0;
  return camera::write_whole_numbers({{"Y", &values}}, kWhite, 8, path);
}

/// Depth and lit of a file in place of the rendering's own.
Result<void> take_masks(const fs::path& path, camera::LoadedImage& rendered) {
  if (path.empty()) return {};
  MAQUETTE_TRY(camera::LoadedImage masks, camera::read_image(path));
  bool any = false;
  for (std::size_t k = 0; k < masks.names.size(); ++k) {
    const std::string& name = masks.names[k];
    if (name != "Z" && name != "lit") continue;
    any = true;
    const Grid<float>& picture = rendered.channels.front();
    Grid<float>& mask = masks.channels[k];
    if (mask.rows() != picture.rows() || mask.cols() != picture.cols())
      return fail(
          camera::kImagesDiffer,
          fmt::format("{}: masks of {} x {} pixels for a rendering of {} x {}", path.string(),
                      mask.cols(), mask.rows(), picture.cols(), picture.rows()));
    const auto own = std::find(rendered.names.begin(), rendered.names.end(), name);
    if (own == rendered.names.end()) {
      rendered.names.push_back(name);
      rendered.channels.push_back(std::move(mask));
    } else {
      rendered.channels[static_cast<std::size_t>(own - rendered.names.begin())] = std::move(mask);
    }
  }
  if (any) return {};
  return fail(camera::kImageFormat,
              fmt::format("{}: neither Z nor lit is in it; --masks takes what `render` or `expose "
                          "--masks` writes",
                          path.string()));
}

std::string page_of(const CompareJob& job, const camera::Comparison& c, const fs::path& folder) {
  Document d;
  d.push_back(Heading{1, "Photograph against rendering"});
  d.push_back(Paragraph{fmt::format("{} against {}. {}. Differences are real - rendered, in x/255.",
                                    job.real.string(), job.rendered.string(), c.state)});
  Table channels{{"channel", "mean absolute", "RMSE", "bias", "between histograms", "gain"}, {}};
  for (const auto& k : c.channels)
    channels.rows.push_back({{k.name},
                             number(k.mean_abs_diff_255),
                             number(k.rmse_255),
                             number(k.bias_255),
                             number(k.histogram_distance_255),
                             number(k.gain, 4)});
  channels.rows.push_back(
      {{"all"}, number(c.mean_abs_diff_255), number(c.rmse_255), number(c.bias_255), {""}, {""}});
  d.push_back(channels);
  Table parts{{"part", "pixels", "mean absolute", "RMSE", "bias"}, {}};
  const auto part = [&](const char* name, const std::optional<camera::PartComparison>& p) {
    if (p)
      parts.rows.push_back({{name},
                            {fmt::format("{}", p->pixels), true},
                            number(p->mean_abs_diff_255),
                            number(p->rmse_255),
                            number(p->bias_255)});
  };
  part("edges of shadows", c.shadow_edges);
  part("elsewhere", c.rest);
  if (!parts.rows.empty()) d.push_back(parts);
  d.push_back(Paragraph{fmt::format(
      "{} pixels compared, {} of the background left out.{}{}", c.pixels, c.background_pixels,
      std::isnan(c.ssim) ? "" : fmt::format(" SSIM {:.4f}.", c.ssim),
      std::isnan(c.flip) ? "" : fmt::format(" FLIP {:.4f}.", c.flip))});
  if (job.options.pictures) {
    d.push_back(Picture{folder / "difference.png",
                        "signed difference: grey is none, brighter where "
                        "the photograph is brighter"});
    d.push_back(Picture{folder / "absolute.png",
                        "absolute difference: (real - rendered) + (rendered - "
                        "real), each cut at zero"});
    if (!c.edges.empty())
      d.push_back(Picture{folder / "edges.png",
                          "white: edges of light and shadow, which have figures of their own; "
                          "black: left out"});
  }
  return "<!doctype html><meta charset=\"utf-8\"><title>compare</title><style>body{font:15px "
         "sans-serif;max-width:70em;margin:1em auto;padding:0 1em}img{max-width:100%}td,th{padding:"
         "2px 10px;text-align:left}</style>\n" +
         to_html(d);
}

}  // namespace

Result<JobResult> compare_job(const CompareJob& job, const fs::path& folder, const RunContext&) {
  MAQUETTE_TRY(const auto real, camera::read_image(job.real));
  MAQUETTE_TRY(auto rendered, camera::read_image(job.rendered));
  MAQUETTE_TRY_VOID(take_masks(job.masks, rendered));
  auto comparison = camera::compare_images(real, rendered, job.options);
  if (!comparison)
    return tl::unexpected(
        std::move(comparison.error())
            .within(fmt::format("{} and {}", job.real.string(), job.rendered.string())));
  std::error_code ec;
  fs::create_directories(folder, ec);
  if (ec) return tl::unexpected(write_error(folder, ec.value()));
  JobResult result;
  result.outputs = {folder / "compare.json", folder / "compare.html"};
  result.figures_json = camera::to_json(*comparison);
  MAQUETTE_TRY_VOID(write_file(result.outputs[0], result.figures_json));
  if (job.options.pictures) {
    for (const auto& [name, picture] : {std::pair{"difference.png", &comparison->difference},
                                        {"absolute.png", &comparison->absolute},
                                        {"edges.png", &comparison->edges}}) {
      if (picture->empty()) continue;
      result.outputs.push_back(folder / name);
      MAQUETTE_TRY_VOID(write_photograph(*picture, result.outputs.back()));
    }
  }
  MAQUETTE_TRY_VOID(write_file(result.outputs[1], page_of(job, *comparison, folder)));
  result.note = fmt::format("mean difference {:.2f}/255", comparison->mean_abs_diff_255);
  if (comparison->mean_abs_diff_255 > job.max_mean_255)
    result.unmet = fmt::format("the mean difference of {:.3f}/255 is more than {}/255",
                               comparison->mean_abs_diff_255, job.max_mean_255);
  return result;
}

}  // namespace maquette::tools
