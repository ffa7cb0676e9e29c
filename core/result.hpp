// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file result.hpp
/// How a room says that it could not do its work.
///
///   bad input, bad file, cancelled run  -> Result<T>, never an exception
///   a bug of ours (broken precondition) -> MAQUETTE_CHECK (core/check.hpp)
///   a third-party library threw         -> caught in the one .cpp that calls it
///                                          and turned into a Result there

#include <string>
#include <string_view>
#include <utility>

#include <tl/expected.hpp>

namespace maquette {

/// What kind of failure; decides the program's exit code (docs/errors.md).
enum class ErrorKind {
  tolerance = 1,    ///< a bound or tolerance the user asked for is not met
  bad_input = 2,    ///< file, option or configuration is wrong
  environment = 3,  ///< disk full, permission, missing driver, busy directory, cancelled
  internal = 4,     ///< our bug
};

/// A stable, greppable name such as "CNC_HEIGHT_NOT_FINITE". Declared beside the
/// function that returns it and listed in docs/errors.md; core knows only its own.
struct ErrorCode {
  std::string_view name;
  ErrorKind kind = ErrorKind::bad_input;
  friend constexpr bool operator==(ErrorCode a, ErrorCode b) { return a.name == b.name; }
};

struct Error {
  ErrorCode code;
  std::string message;  ///< for a person: which file, where, what was expected, what to do

  /// Adds the caller's view in front: "site.toml: tile 12/40: height is NaN at row 3".
  [[nodiscard]] Error within(std::string_view where) && {
    message.insert(0, ": ").insert(0, where);
    return std::move(*this);
  }
};

template <class T>
using Result = tl::expected<T, Error>;

[[nodiscard]] inline tl::unexpected<Error> fail(ErrorCode code, std::string message) {
  return tl::unexpected<Error>(Error{code, std::move(message)});
}

/// The run was asked to stop (Ctrl-C); nothing half-done is left behind.
inline constexpr ErrorCode kCancelled{"CORE_CANCELLED", ErrorKind::environment};

}  // namespace maquette

/// Unwraps a Result into a new variable, or hands its error to the caller:
///   MAQUETTE_TRY(const auto field, read_model_field(path));
#define MAQUETTE_TRY(declaration, expression) \
  MAQUETTE_TRY_IMPL_(MAQUETTE_TRY_CAT_(maquette_try_, __COUNTER__), declaration, expression)
#define MAQUETTE_TRY_IMPL_(tmp, declaration, expression)                        \
  auto tmp = (expression);                                                      \
  if (!tmp) return ::tl::unexpected<::maquette::Error>(std::move(tmp).error()); \
  declaration = *std::move(tmp)
/// The same for Result<void>.
#define MAQUETTE_TRY_VOID(expression) \
  MAQUETTE_TRY_VOID_IMPL_(MAQUETTE_TRY_CAT_(maquette_try_, __COUNTER__), expression)
#define MAQUETTE_TRY_VOID_IMPL_(tmp, expression) \
  if (auto tmp = (expression); !tmp)             \
  return ::tl::unexpected<::maquette::Error>(std::move(tmp).error())
#define MAQUETTE_TRY_CAT_(a, b) MAQUETTE_TRY_CAT2_(a, b)
#define MAQUETTE_TRY_CAT2_(a, b) a##b
