// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <tuple>

#include <fmt/format.h>

#include "core/markup.hpp"
#include "diagnosis/compensation.hpp"

namespace maquette::diagnosis {
namespace {

std::string colour(double v, double limit) {
  const double t = std::clamp(v / limit, -1.0, 1.0);
  const auto mix = [](double a, double b, double k) {
    return static_cast<int>(std::lround(a + k * (b - a)));
  };
  return t < 0.0 ? fmt::format("#{:02x}{:02x}{:02x}", mix(247, 33, -t), mix(247, 102, -t),
                               mix(247, 172, -t))
                 : fmt::format("#{:02x}{:02x}{:02x}", mix(247, 178, t), mix(247, 24, t),
                               mix(247, 43, t));
}

/// Means of two by two cells: structure shows where single cells show noise.
Grid<float> coarser(const Grid<float>& v) {
  Grid<float> out((v.rows() + 1) / 2, (v.cols() + 1) / 2, NAN);
  for (std::ptrdiff_t r = 0; r < out.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < out.cols(); ++c) {
      float sum = 0.0F, n = 0.0F;
      for (std::ptrdiff_t i = 2 * r; i < std::min(v.rows(), 2 * r + 2); ++i)
        for (std::ptrdiff_t k = 2 * c; k < std::min(v.cols(), 2 * c + 2); ++k)
          if (!std::isnan(v(i, k))) {
            sum += v(i, k);
            n += 1.0F;
          }
      if (n > 0.0F) out(r, c) = sum / n;
    }
  return out;
}

/// Runs of equal colour as rectangles: a map of 60 x 60 in some 50 kB.
std::string map_svg(const Grid<float>& v, double limit, const std::string& caption) {
  std::string s = fmt::format(
      "<figure><svg viewBox=\"0 0 {} {}\" class=\"map\" shape-rendering=\"crispEdges\">", v.cols(),
      v.rows());
  for (std::ptrdiff_t r = 0; r < v.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < v.cols();) {
      const auto at = [&](std::ptrdiff_t i) {
        return std::isnan(v(r, i))
                   ? std::string("#bbb")
                   : colour(std::round(16.0 * static_cast<double>(v(r, i)) / limit) / 16.0 * limit,
                            limit);
      };
      const std::string now = at(c);
      std::ptrdiff_t e = c + 1;
      while (e < v.cols() && at(e) == now) ++e;
      s += fmt::format("<rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"1\" fill=\"{}\"/>", c,
                       v.rows() - 1 - r, e - c, now);
      c = e;
    }
  return s + "</svg><figcaption>" + caption + "</figcaption></figure>";
}

std::string maps(const Map& map, bool causes, const std::string& unit) {
  const Grid<float> before = coarser(map.before), after = coarser(map.after);
  Grid<float> taken = before;
  std::vector<double> sizes;
  for (std::size_t i = 0; i < before.cells().size(); ++i) {
    taken.cells()[i] -= after.cells()[i];
    if (!std::isnan(before.cells()[i]))
      sizes.push_back(std::abs(static_cast<double>(before.cells()[i])));
  }
  std::sort(sizes.begin(), sizes.end());
  const double limit =
      sizes.empty()
          ? 0.05
          : std::fmax(
                0.005,
                sizes[static_cast<std::size_t>(0.98 * static_cast<double>(sizes.size() - 1))]);
  std::string s = "<div class=\"pair\">";
  if (causes)
    s += map_svg(before, limit, "residual before") +
         map_svg(taken, limit, "what the causes take of it");
  s += map_svg(after, limit, causes ? "residual after" : "residual") + "</div><p>";
  s += "<svg viewBox=\"0 0 330 26\" width=\"330\">";
  for (int i = 0; i < 33; ++i)
    s += fmt::format("<rect x=\"{}\" y=\"0\" width=\"10\" height=\"12\" fill=\"{}\"/>", 10 * i,
                     colour((i - 16) / 16.0, 1.0));
  return s + fmt::format(
                 "<text x=\"0\" y=\"24\">{:.3f} {}, too {}</text><text x=\"330\" y=\"24\" "
                 "text-anchor=\"end\">+{:.3f} {}, too {}</text></svg> One scale for all; means "
                 "of squares of {:.3g} mm, north is up.</p>",
                 -limit, unit, unit == "mm" ? "low" : "dark", limit, unit,
                 unit == "mm" ? "high" : "bright", 2.0 * map.cell_mm);
}

std::string plot_svg(const Dependence& p, const std::string& unit) {
  if (p.at.size() < 2) return "";
  double limit = 1e-4;
  for (std::size_t i = 0; i < p.at.size(); ++i)
    limit = std::fmax(limit, std::fmax(std::abs(p.before[i]), std::abs(p.after[i])));
  const double w = 300.0, h = 140.0;
  const auto x = [&](std::size_t i) {
    return 40.0 + (w - 50.0) * (p.at[i] - p.at.front()) / (p.at.back() - p.at.front());
  };
  const auto y = [&](double v) { return 0.5 * h - 0.42 * h * v / limit; };
  std::string s = fmt::format(
      "<figure><svg viewBox=\"0 0 {} {}\" class=\"plot\"><line x1=\"40\" x2=\"{}\" y1=\"{}\" "
      "y2=\"{}\" stroke=\"#ccc\"/>",
      w, h, w - 10.0, y(0.0), y(0.0));
  // A class without points is a gap, not a line across.
  double step = INFINITY;
  for (std::size_t i = 1; i < p.at.size(); ++i) step = std::fmin(step, p.at[i] - p.at[i - 1]);
  for (std::size_t i = 0; i < p.at.size(); ++i)
    s += fmt::format(
        "<line x1=\"{0:.1f}\" x2=\"{0:.1f}\" y1=\"{1:.1f}\" y2=\"{2:.1f}\" stroke=\"#92c5de\" "
        "stroke-width=\"4\"/>",
        x(i), y(p.after[i] - 2.0 * p.sigma[i]), y(p.after[i] + 2.0 * p.sigma[i]));
  const auto line = [&](const std::vector<double>& v, const char* c) {
    for (std::size_t i = 0; i < v.size(); ++i) {
      const bool begins = i == 0 || p.at[i] - p.at[i - 1] > 1.5 * step;
      if (begins)
        s += fmt::format("{}<polyline fill=\"none\" stroke=\"{}\" stroke-width=\"1.5\" points=\"",
                         i == 0 ? "" : "\"/>", c);
      s += fmt::format("{:.1f},{:.1f} ", x(i), y(v[i]));
    }
    s += "\"/>";
  };
  line(p.before, "#b2182b");
  line(p.after, "#2166ac");
  s += fmt::format(
      "<text x=\"2\" y=\"{}\">{:.3f}</text><text x=\"2\" y=\"{}\">{:.3f}</text><text x=\"40\" "
      "y=\"{}\">{:.3g}</text><text x=\"{}\" y=\"{}\" text-anchor=\"end\">{:.3g}</text>",
      y(limit) + 4.0, limit, y(-limit), -limit, h - 1.0, p.at.front(), w - 10.0, h - 1.0,
      p.at.back());
  return s + fmt::format("</svg><figcaption>mean residual, {}, against {}</figcaption></figure>",
                         unit, markup_escaped(p.covariate));
}

std::string list(const std::vector<std::string>& names) {
  std::string s;
  for (const auto& n : names) s += (s.empty() ? "" : ", ") + n;
  return s.empty() ? "nothing" : s;
}

std::string controls_html(const Controls& c) {
  std::string s = fmt::format(
      "<h2>Controls</h2><p class=\"{}\">{}</p><p>The same analysis of {} points at places of "
      "these, of noise simulated as fitted. With the causes above in the model and nothing else "
      "it says: {}, naming {}.</p>",
      c.passed() ? "good" : "bad",
      !c.passed()            ? "Not passed: read the causes above with care."
      : c.recoveries.empty() ? "Passed: nothing is claimed where nothing is."
                             : "Passed: nothing is claimed where nothing is, and what is named "
                               "comes back.",
      c.points, c.null_verdict, list(c.null_claims));
  if (c.recoveries.empty()) return s;
  s += "<table><tr><th>injected</th><th>named</th><th>parameter</th><th>injected</th><th>found</th>"
       "<th>off by, standard errors</th></tr>";
  for (const auto& r : c.recoveries) {
    std::string names, in, out, off;
    for (const auto& z : r.sizes) {
      const char* next = &z == &r.sizes.front() ? "" : "<br>";
      names += next + z.parameter;
      in += fmt::format("{}{:.4g}", next, z.injected);
      out += fmt::format("{}{:.4g} &plusmn; {:.2g}", next, z.found, z.sigma);
      off += fmt::format("{}{:+.1f}", next, (z.found - z.injected) / std::fmax(1e-300, z.sigma));
    }
    s += fmt::format("<tr><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>",
                     r.effect, r.named_as.empty() ? "not found" : r.named_as, names, in, out, off);
  }
  s += "</table>";
  if (!c.false_claims.empty())
    s += "<p class=\"bad\">Named beside them: " + list(c.false_claims) + ".</p>";
  return s;
}

/// Spread before and after, and the floor.
std::string bars(const Diagnosis& d) {
  const double most = std::fmax(1e-9, std::fmax(d.rms_before, d.rms_after));
  std::string s = "<svg viewBox=\"0 0 620 62\" width=\"620\">";
  double y = 0.0;
  for (const auto& [name, value, fill] : {std::tuple{"before", d.rms_before, "#b2182b"},
                                          {"after", d.rms_after, "#2166ac"},
                                          {"noise floor", d.rms_noise, "#999"}}) {
    s += fmt::format(
        "<text x=\"70\" y=\"{}\" text-anchor=\"end\">{}</text><rect x=\"76\" y=\"{}\" "
        "width=\"{:.1f}\" "
        "height=\"14\" fill=\"{}\"/><text x=\"{:.1f}\" y=\"{}\">{:.4f} {}</text>",
        y + 12.0, name, y + 1.0, 460.0 * value / most, fill, 82.0 + 460.0 * value / most, y + 12.0,
        value, d.unit);
    y += 20.0;
  }
  return s + "</svg>";
}

std::string next_html(const Diagnosis& d) {
  const bool points = d.unit == "mm";
  std::string s = "<h2>Next</h2><ul>";
  for (const Cause& c : d.causes) {
    if (!c.separate_by.empty())
      s += fmt::format("<li>{} {}: {}.</li>",
                       c.equivalent.empty() ? "To make sure of" : "To tell what else may be",
                       c.effect, markup_escaped(c.separate_by));
  }
  if (d.causes.empty() && d.remainder.found)
    s += points ? "<li>Look at the places of the map by eye; measure them again from another "
                  "station, so that what the scanner adds is told from what the part has.</li>"
                : "<li>Look at the places of the map by eye; take them again from another place "
                  "and under another lamp: what stays with the part is the part's.</li>";
  if (!d.causes.empty())
    s += fmt::format(
        "<li>The simulation with these causes is <code>extended.toml</code>, which {} "
        "diagnose {}.</li>",
        points ? "verify, scan and" : "", points ? "take" : "takes");
  if (!compensation_of(d, {}).used.empty())
    s += "<li>What a program can make good is in <code>compensation.toml</code>: "
         "<code>maquette compensate part.ngc --by compensation.toml --extended "
         "extended.toml</code> says what it gains.</li>";
  if (!points) return s + "</ul>";
  return s +
         "<li><code>maquette detectability case.toml</code> says how small other causes could be "
         "unseen, and what further measurement helps most.</li></ul>";
}

std::string stones_html(const StoneReport& r) {
  std::string s = "<h2>Stones</h2><table><tr><th>stone</th><th>state</th></tr>";
  for (const auto& [number, state] : r.states)
    s += fmt::format("<tr><td>{}</td><td>{}</td></tr>", number, state);
  s += "</table>";
  if (r.points > 0)
    s += fmt::format(
        "<p>Ranges about the stones, {} points in patches that had no part in the fit: {:.4f} mm "
        "rms before, {:.4f} after; noise alone gives {:.4f}.</p>",
        r.points, r.rms_before, r.rms_after, r.rms_noise);
  for (const std::string& what : r.unexplained)
    s += "<p class=\"bad\">" + markup_escaped(what) + ": no cause of the library.</p>";
  return s;
}

}  // namespace

std::string to_html(const Diagnosis& d) {
  std::string s =
      "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>Diagnosis</title><style>"
      "body{font:15px/1.45 system-ui,sans-serif;max-width:1000px;margin:2em auto;padding:0 "
      "1em;color:#222}"
      "table{border-collapse:collapse}td,th{padding:.25em .7em;border-bottom:1px solid "
      "#ddd;text-align:left;vertical-align:top}"
      ".map{width:100%;border:1px solid #999}.pair{display:grid;grid-template-columns:1fr "
      "1fr 1fr;gap:.6em}"
      ".plots{display:flex;flex-wrap:wrap}.plot{width:320px}figure{margin:.3em}text{font-size:10px;"
      "fill:#555}"
      "figcaption{color:#555;font-size:13px}.verdict{font-size:1.3em}.good{color:#1b7837}.bad{"
      "color:#b2182b}</style>";
  s += fmt::format(
      "<h1>Diagnosis</h1><p class=\"verdict\">{}</p>",
      d.verdict == "consistent"
          ? "Consistent: beyond noise the data show nothing that the simulation lacks."
      : d.verdict == "explained"
          ? "Explained: the causes below account for what the simulation lacked."
      : d.verdict == "partly_explained"
          ? "Partly explained: beside the causes below something remains that no cause of the "
            "library explains."
          : "Unexplained: there is more than noise, and no cause of the library explains it.");
  if (!d.causes.empty()) {
    s += "<h2>Causes</h2><table><tr><th>cause</th><th>what "
         "happened</th><th>parameters</th><th>share of the excess</th><th>p</th><th>cannot be told "
         "from</th><th>next measurement</th></tr>";
    for (const Cause& c : d.causes) {
      std::string parameters = markup_escaped(c.law), equivalent;
      for (const Estimate& p : c.parameters)
        parameters += fmt::format("<br>{} = {:.4g} &plusmn; {:.2g}", p.name, p.value, p.sigma);
      for (const auto& [name, value] : c.fixed)
        parameters += fmt::format("<br>{} = {:.4g}", name, value);
      for (const auto& e : c.equivalent) equivalent += e + "<br>";
      const Effect* effect = find_effect(c.effect);
      s += fmt::format(
          "<tr><td><b>{}</b></td><td>{}{}</td><td>{}</td><td>{:.0f} "
          "%</td><td>{:.1e}</td><td>{}</td><td>{}</td></tr>",
          c.effect, effect ? markup_escaped(effect->says) : "",
          effect && !effect->correction.empty()
              ? "<br><i>Correction: " + markup_escaped(effect->correction) + "</i>"
              : "",
          parameters, 100.0 * c.share, c.p_value, equivalent.empty() ? "-" : equivalent,
          markup_escaped(c.separate_by));
    }
    s += "</table>";
  }
  s += fmt::format(
      "<h2>Gain</h2><p>On {} {} in blocks that had no part in choosing or confirming: {:.4f} {} "
      "rms "
      "before, {:.4f} after; noise alone gives {:.4f}.</p>",
      d.n_report, d.unit == "mm" ? "points" : "pixels", d.rms_before, d.unit, d.rms_after,
      d.rms_noise);
  s += bars(d);
  if (!d.held_out.empty()) {
    s += "<h2>Photographs held out</h2><p>They had no part in the choice. Mean absolute difference "
         "of "
         "the part's pixels from what was expected, / 255.</p><table><tr><th>photograph</th>"
         "<th>before</th><th>after</th><th>of noise</th></tr>";
    for (const Diagnosis::HeldOut& h : d.held_out)
      s += fmt::format("<tr><td>{}</td><td>{:.2f}</td><td>{:.2f}</td><td>{:.2f}</td></tr>",
                       markup_escaped(h.image), h.before, h.after, h.noise);
    s += "</table>";
  }
  s += "<h2>Where</h2>" + maps(d.map, !d.causes.empty(), d.unit);
  s += "<h2>What the residual depends on</h2><p>Red before, blue after; bars: two standard errors "
       "of white noise.</p><div class=\"plots\">";
  for (const Dependence& p : d.dependences) s += plot_svg(p, d.unit);
  s += "</div><h2>What remains</h2>";
  if (d.remainder.found) {
    std::string kinds;
    for (const auto& k : d.remainder.kinds) kinds += (kinds.empty() ? "" : ", ") + k;
    s += fmt::format(
        "<p>More than noise: {}. {:.4f} {} rms, {:.0f} % of the excess variance. It has no name "
        "here.</p>",
        kinds, d.remainder.structured_rms, d.unit, 100.0 * d.remainder.share);
  } else {
    s += "<p>Nothing that a stationary random process would not give.</p>";
  }
  s += d.unit != "mm" ? std::string("<p>")
       : d.remainder.smooth_mm > 0.0
           ? fmt::format(
                 "<p>Of the noise {:.4f} mm are a smooth random process, correlated over "
                 "{:.0f} mm; it is no cause.",
                 d.remainder.smooth_mm, d.remainder.smooth_length_mm)
           : std::string("<p>No part of the noise is smooth over more than a few mm.");
  s += fmt::format(" Neighbouring squares' correlation {:.3f}.</p>", d.remainder.morans_i);
  if (d.stones) s += stones_html(*d.stones);
  if (d.controls) s += controls_html(*d.controls);
  s += next_html(d);
  if (!d.poses.empty()) {
    s += "<h2>Poses of the measurements</h2><table><tr><th>file</th><th>shift x, y, z, "
         "mm</th><th>turn x, y, z, urad</th></tr>";
    for (const PoseEstimate& p : d.poses)
      s += fmt::format(
          "<tr><td>{}</td><td>{:.4f}, {:.4f}, {:.4f} (&plusmn; {:.4f})</td><td>{:.0f}, {:.0f}, "
          "{:.0f} "
          "(&plusmn; {:.0f})</td></tr>",
          markup_escaped(p.set_up), p.shift_mm.x, p.shift_mm.y, p.shift_mm.z,
          norm(p.shift_sigma_mm), p.turn_urad.x, p.turn_urad.y, p.turn_urad.z,
          norm(p.turn_sigma_urad));
    s += "</table>";
  }
  if (!d.ranking.empty()) {
    const double best = std::fmax(1.0, d.ranking.front().gain);
    s += "<h2>Ranking</h2><p>What each cause gains alone on the blocks for choosing, in -2 log "
         "likelihood less the price of its parameters; below 0 it is not worth them.</p><table>";
    for (std::size_t i = 0; i < std::min<std::size_t>(10, d.ranking.size()); ++i) {
      const Ranked& r = d.ranking[i];
      s += fmt::format(
          "<tr><td>{}</td><td>{}</td><td>{:.0f}</td><td><svg width=\"200\" height=\"12\"><rect "
          "width=\"{:.1f}\" height=\"12\" fill=\"#2166ac\"/></svg></td></tr>",
          r.effect, markup_escaped(r.law), r.gain, 200.0 * std::clamp(r.gain / best, 0.0, 1.0));
    }
    s += "</table>";
  }
  s += "<h2>Ruled out</h2><table>";
  for (const Rejected& r : d.rejected)
    s += fmt::format("<tr><td>{}</td><td>{}</td></tr>", r.effect, markup_escaped(r.why));
  s += "</table>";
  if (!d.untestable.empty()) {
    s += "<h2>Cannot be tested with these data</h2><p>";
    for (const auto& e : d.untestable) s += e + " ";
    s += "</p>";
  }
  for (const auto& n : d.notes) s += "<p>" + markup_escaped(n) + "</p>";
  return s + "</html>\n";
}

}  // namespace maquette::diagnosis
