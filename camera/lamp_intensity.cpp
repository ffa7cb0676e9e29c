// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <charconv>
#include <cmath>
#include <numbers>
#include <string_view>

#include <fmt/format.h>

#include "camera/lamp.hpp"
#include "core/files.hpp"

namespace maquette::camera {
namespace {

/// Words between blanks and commas, with the line each stands in.
class Words {
 public:
  explicit Words(std::string_view text, int line = 1) : text_(text), line_(line) {}

  [[nodiscard]] int line() const { return line_; }
  /// Is there another word? Lines whose first one begins with # are passed over.
  bool more() {
    while (true) {
      const auto begins = text_.find_first_not_of(" \t\r\n");
      if (begins == std::string_view::npos) return false;
      if (text_[begins] != '#') return true;
      line_ += static_cast<int>(std::count(text_.begin(), text_.begin() + begins, '\n'));
      text_.remove_prefix(begins);
      next_line();
    }
  }
  /// The next line without its end; nothing at the end of the file.
  std::optional<std::string_view> next_line() {
    if (text_.empty()) return std::nullopt;
    const auto end = text_.find('\n');
    std::string_view line = text_.substr(0, end);
    text_.remove_prefix(end == std::string_view::npos ? text_.size() : end + 1);
    ++line_;
    if (!line.empty() && line.back() == '\r') line.remove_suffix(1);
    return line;
  }
  std::optional<double> next_number() {
    constexpr std::string_view kBlank = " \t\r\n,";
    while (!text_.empty() && kBlank.find(text_.front()) != std::string_view::npos) {
      if (text_.front() == '\n') ++line_;
      text_.remove_prefix(1);
    }
    const std::string_view word = text_.substr(0, text_.find_first_of(kBlank));
    std::string_view digits = word;
    if (digits.starts_with('+')) digits.remove_prefix(1);
    double value = 0.0;
    const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
    if (error != std::errc{} || end != digits.data() + digits.size() || !std::isfinite(value))
      return std::nullopt;
    text_.remove_prefix(word.size());
    return value;
  }

 private:
  std::string_view text_;
  int line_;
};

using Path = std::filesystem::path;

tl::unexpected<Error> wrong(const Path& path, int line, const std::string& what) {
  return fail(kIntensityFile, fmt::format("{}: line {}: {}", path.string(), line, what));
}

/// `count` numbers; ascending from 0 if they are angles.
Result<std::vector<double>> take(const Path& path, Words& words, double count, const char* what) {
  if (!(count >= 0.0 && count <= 1e6) || count != std::floor(count))
    return wrong(path, words.line(), fmt::format("{} {}: a whole number expected", count, what));
  std::vector<double> values;
  values.reserve(static_cast<std::size_t>(count));
  for (double i = 0; i < count; ++i) {
    const auto value = words.next_number();
    if (!value)
      return wrong(path, words.line(),
                   fmt::format("number {:.0f} of {:.0f} {} expected", i + 1, count, what));
    values.push_back(*value);
  }
  return values;
}

Result<void> check_angles(const Path& path, int line, const std::vector<double>& v,
                          const char* what) {
  for (std::size_t i = 0; i < v.size(); ++i)
    if ((i == 0 && v[i] != 0.0) || (i > 0 && !(v[i] > v[i - 1])))
      return wrong(path, line,
                   fmt::format("{}: angles must begin with 0, the lamp's axis, and ascend", what));
  return {};
}

Result<void> check_intensities(const Path& path, int line, const std::vector<double>& v) {
  for (const double x : v)
    if (x < 0.0) return wrong(path, line, fmt::format("an intensity of {} is negative", x));
  return {};
}

Result<IntensityTable> read_ies(const Path& path, std::string_view text) {
  Words words(text);
  while (true) {
    const auto line = words.next_line();
    if (!line) return wrong(path, words.line(), "no TILT= line; is this an LM-63 file?");
    if (!line->starts_with("TILT=")) continue;
    if (*line == "TILT=NONE") break;
    if (*line != "TILT=INCLUDE")
      return wrong(path, words.line() - 1, "TILT= names another file; NONE or INCLUDE expected");
    // Geometry of the burner, number of pairs, angles, factors: for a lamp in its design position
    // the factor is 1.
    MAQUETTE_TRY(const auto tilt, take(path, words, 2, "words of TILT"));
    MAQUETTE_TRY(const auto pairs, take(path, words, 2.0 * tilt[1], "words of TILT"));
    break;
  }
  MAQUETTE_TRY(const auto head, take(path, words, 13, "values after TILT"));
  if (head[5] != 1.0)
    return wrong(
        path, words.line(),
        fmt::format("photometric type {:.0f}; type C (1) expected: turn the table's axis to "
                    "vertical angle 0",
                    head[5]));
  IntensityTable table;
  MAQUETTE_TRY(table.angle_deg, take(path, words, head[3], "vertical angles"));
  MAQUETTE_TRY_VOID(check_angles(path, words.line(), table.angle_deg, "vertical"));
  MAQUETTE_TRY(table.azimuth_deg, take(path, words, head[4], "horizontal angles"));
  MAQUETTE_TRY_VOID(check_angles(path, words.line(), table.azimuth_deg, "horizontal"));
  MAQUETTE_TRY(table.intensity, take(path, words, head[3] * head[4], "intensities"));
  MAQUETTE_TRY_VOID(check_intensities(path, words.line(), table.intensity));
  if (table.intensity.empty()) return wrong(path, words.line(), "no intensity");
  const double last = table.azimuth_deg.back();
  if (last != 0.0 && last != 90.0 && last != 180.0 && last != 360.0)
    return wrong(path, words.line(),
                 fmt::format("horizontal angles end at {}; 0, 90, 180 or 360 expected", last));
  for (double& x : table.intensity) x *= head[2] * head[10];  // multiplier, ballast factor
  return table;
}

Result<IntensityTable> read_csv(const Path& path, std::string_view text) {
  Words words(text);
  const auto head = words.next_line();
  if (!head || !head->starts_with("angle_deg,intensity"))
    return wrong(path, 1, "the head angle_deg,intensity expected");
  IntensityTable table{{}, {0.0}, {}};
  while (words.more()) {
    MAQUETTE_TRY(const auto row, take(path, words, 2, "values of a row"));
    table.angle_deg.push_back(row[0]);
    table.intensity.push_back(row[1]);
  }
  if (table.angle_deg.empty()) return wrong(path, words.line(), "no row");
  MAQUETTE_TRY_VOID(check_angles(path, words.line(), table.angle_deg, "angle_deg"));
  MAQUETTE_TRY_VOID(check_intensities(path, words.line(), table.intensity));
  return table;
}

}  // namespace

double IntensityTable::at(double angle, double azimuth) const {
  if (angle > angle_deg.back()) return 0.0;
  double turn = std::fmod(std::fmod(azimuth, 360.0) + 360.0, 360.0);
  const double last = azimuth_deg.back();
  if (last < 360.0 && turn > 180.0) turn = 360.0 - turn;  // two halves alike
  if (last < 180.0 && turn > 90.0) turn = 180.0 - turn;   // four quarters alike
  const auto place = [](const std::vector<double>& nodes, double value) {
    const auto above = std::upper_bound(nodes.begin(), nodes.end(), value);
    const auto below = static_cast<std::size_t>(std::max<std::ptrdiff_t>(
        0, std::min<std::ptrdiff_t>(above - nodes.begin(), std::ssize(nodes) - 1) - 1));
    const double share =
        nodes.size() < 2
            ? 0.0
            : std::clamp((value - nodes[below]) / (nodes[below + 1] - nodes[below]), 0.0, 1.0);
    return std::pair{below, share};
  };
  const auto [a, s] = place(angle_deg, angle);
  const auto [b, t] = place(azimuth_deg, turn);
  const auto value = [&](std::size_t i, std::size_t j) {
    return intensity[std::min(j, azimuth_deg.size() - 1) * angle_deg.size() +
                     std::min(i, angle_deg.size() - 1)];
  };
  return (1 - t) * ((1 - s) * value(a, b) + s * value(a + 1, b)) +
         t * ((1 - s) * value(a, b + 1) + s * value(a + 1, b + 1));
}

double solid_angle_sr(const IntensityTable& table) {
  constexpr double kDegree = std::numbers::pi / 180.0;
  const double axis = table.at(0.0, 0.0);
  double sum = 0.0;
  const std::size_t around = table.azimuth_deg.size() > 1 ? 360 : 1;
  for (std::size_t k = 0; k < around; ++k) {
    const double azimuth = around > 1 ? static_cast<double>(k) : 0.0;
    for (std::size_t i = 1; i < table.angle_deg.size(); ++i) {
      // Intensity is linear in the angle between nodes: its integral with the sine is exact.
      const double a = kDegree * table.angle_deg[i - 1], b = kDegree * table.angle_deg[i];
      const double at_a = table.at(table.angle_deg[i - 1], azimuth),
                   at_b = table.at(table.angle_deg[i], azimuth);
      const double slope = (at_b - at_a) / (b - a);
      sum += at_a * std::cos(a) - at_b * std::cos(b) + slope * (std::sin(b) - std::sin(a));
    }
  }
  return 2.0 * std::numbers::pi * sum / static_cast<double>(around) / axis;
}

Result<IntensityTable> read_intensity_csv(const Path& name, std::string_view text) {
  return read_csv(name, text);
}

Result<IntensityTable> read_intensity(const Path& path) {
  MAQUETTE_TRY(const std::string text, read_file(path));
  std::string extension = path.extension().string();
  for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return extension == ".ies" ? read_ies(path, text) : read_csv(path, text);
}

}  // namespace maquette::camera
