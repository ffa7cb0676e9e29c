// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <charconv>
#include <cstddef>
#include <string>

#include "meshing/detail/mesh_readers.hpp"

namespace maquette::meshing::detail {
namespace {

constexpr std::string_view kBlank = " \t\r\f\v";
constexpr std::string_view kBlankOrEnd = " \t\r\f\v\n";

std::string_view without_plus(std::string_view token) {
  if (token.size() > 1 && token[0] == '+' && token[1] != '-') token.remove_prefix(1);
  return token;
}

}  // namespace

std::optional<double> parse_double(std::string_view token) {
  token = without_plus(token);
  double x = 0.0;
  const auto [end, error] = std::from_chars(token.data(), token.data() + token.size(), x);
  if (end != token.data() + token.size()) return std::nullopt;
  if (error == std::errc::result_out_of_range) {
    // Too small or too large: the sign of the exponent tells them apart.
    const auto e = token.find_first_of("eE");
    const bool small = e != std::string_view::npos && token.substr(e + 1).starts_with('-');
    return small ? std::optional(0.0) : std::nullopt;
  }
  return error == std::errc{} ? std::optional(x) : std::nullopt;
}

std::optional<std::int64_t> parse_integer(std::string_view token) {
  token = without_plus(token);
  std::int64_t x = 0;
  const auto [end, error] = std::from_chars(token.data(), token.data() + token.size(), x);
  if (error != std::errc{} || end != token.data() + token.size()) return std::nullopt;
  return x;
}

std::string_view Tokens::next() {
  for (;;) {
    const std::string_view token = next_in_line();
    if (!token.empty() || !next_line()) return token;
  }
}

std::string_view Tokens::next_in_line() {
  rest_.remove_prefix(std::min(rest_.find_first_not_of(kBlank), rest_.size()));
  const std::size_t length = std::min(rest_.find_first_of(kBlankOrEnd), rest_.size());
  const std::string_view token = rest_.substr(0, length);
  rest_.remove_prefix(length);
  return token;
}

bool Tokens::next_line() {
  const std::size_t end = rest_.find('\n');
  if (end == std::string_view::npos) {
    rest_ = {};
    return false;
  }
  rest_.remove_prefix(end + 1);
  ++line_;
  return true;
}

std::string shown(std::string_view token) {
  std::string text(token.substr(0, 40));
  for (char& c : text)
    if (c < 0x20 || c > 0x7e) c = '?';
  return token.size() > 40 ? text + "..." : text;
}

}  // namespace maquette::meshing::detail
