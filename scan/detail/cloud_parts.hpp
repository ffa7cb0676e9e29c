// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file cloud_parts.hpp
/// What the readers of cloud files share.

#include <array>
#include <charconv>
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "scan/cloud.hpp"

namespace maquette::scan::detail {

/// What a column or property of a cloud file can mean to us.
enum Channel : std::size_t { kX, kY, kZ, kIntensity, kNx, kNy, kNz, kChannels };
inline constexpr std::size_t kIgnored = kChannels;

/// By name as files write it: "x", "X_mm", "scalar_intensity", "nx", ...; kIgnored if none.
[[nodiscard]] std::size_t channel_by_name(std::string_view name);

/// Which channels a file has; fills a cloud row by row.
class CloudBuilder {
 public:
  explicit CloudBuilder(std::string file) : file_(std::move(file)) {}

  /// @return false if the channel was there already
  [[nodiscard]] bool declare(std::size_t channel);
  [[nodiscard]] bool has(std::size_t channel) const { return present_[channel]; }
  [[nodiscard]] bool has_position() const { return has(kX) && has(kY) && has(kZ); }
  void reserve(std::size_t points);
  /// @param row  one value per channel; those not declared are not read
  [[nodiscard]] Result<void> add(const std::array<double, kChannels + 1>& row);
  [[nodiscard]] std::size_t size() const { return cloud_.points_mm.size(); }
  void set_station(Vec3 station) { cloud_.station_mm = station; }
  /// SCAN_CLOUD_EMPTY
  [[nodiscard]] Result<Cloud> finish() &&;

 private:
  [[nodiscard]] bool has_normals() const { return has(kNx) && has(kNy) && has(kNz); }
  std::string file_;
  std::array<bool, kChannels> present_{};
  Cloud cloud_;
};

/// A whole token as a number (a leading + and nan, inf are understood); nothing if it
/// is not one.
template <class T>
[[nodiscard]] std::optional<T> parse_number(std::string_view token) {
  if (!token.empty() && token.front() == '+') token.remove_prefix(1);
  T value{};
  const auto [end, error] = std::from_chars(token.data(), token.data() + token.size(), value);
  if (error == std::errc::result_out_of_range || end != token.data() + token.size() ||
      error != std::errc())
    return std::nullopt;
  return value;
}

/// Takes the next token (no blanks inside) off the front of `text`; empty at the end.
[[nodiscard]] std::string_view next_token(std::string_view& text,
                                          std::string_view separators = " \t\r");

/// The line at `at`, without its end; moves `at` behind it.
[[nodiscard]] std::string_view next_line(std::string_view data, std::size_t& at);

/// Reads "scanner_position_mm x y z"; nothing if the comment says something else.
[[nodiscard]] Result<std::optional<Vec3>> station_comment(std::string_view comment,
                                                          std::string_view where);

/// A token as an error message may show it: printable, not long.
[[nodiscard]] std::string shown(std::string_view token);

[[nodiscard]] Result<Cloud> read_ply_cloud(std::string_view data, const std::string& file,
                                           const RunContext& run);
[[nodiscard]] Result<Cloud> read_text_cloud(std::string_view data, const std::string& file,
                                            bool is_csv, const RunContext& run);

/// One more scalar for the PLY writer.
struct ExtraScalar {
  std::string_view name;
  const std::vector<float>* values;
};
[[nodiscard]] Result<void> write_ply_cloud(const Cloud& cloud, const RigidTransform* transform,
                                           const ExtraScalar* extra,
                                           const std::filesystem::path& path);

}  // namespace maquette::scan::detail
