// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file schema.hpp
/// A TOML file whose every key is known: name, type, range, default, one line of
/// documentation. The same table parses a file, applies --set, writes the
/// commented template, and yields the values that a stage's fingerprint covers.
///
/// Whatever is wrong with a file is said at once: file, line, key, what is
/// allowed, and the nearest known key; then nothing runs.

#include <cmath>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "core/nearest_name.hpp"
#include "core/result.hpp"
#include "core/vec.hpp"

namespace maquette::tools {

inline constexpr ErrorCode kConfigSyntax{"TOOLS_CONFIG_SYNTAX"};
inline constexpr ErrorCode kConfigInvalid{"TOOLS_CONFIG_INVALID"};
inline constexpr ErrorCode kVariableNotSet{"TOOLS_VARIABLE_NOT_SET"};

/// Where a value goes. A path is a string in which ${NAME} and ${NAME:-default} are
/// replaced from the environment, relative to the file that names it. One path is a list of
/// paths, too.
using Target = std::variant<double*, std::int64_t*, bool*, std::string*, std::filesystem::path*,
                            std::vector<double>*, std::vector<std::string>*,
                            std::vector<std::filesystem::path>*, Vec3*, Quaternion*>;

struct Key {
  std::string name;                        ///< dotted: "mill.stepover_mm"
  Target target;                           ///< holds the default until a file is read
  std::string doc;                         ///< one line
  double min = -INFINITY, max = INFINITY;  ///< numbers and elements of number lists
  std::vector<std::string> choices{};      ///< strings and elements of string lists; empty: any
  bool required = false;
};

class Schema {
 public:
  Schema& add(Key key);
  /// A comment line before the keys that follow, in the template.
  Schema& section(std::string name, std::string doc);
  /// [[name]] tables: `element` appends one element and describes its keys.
  Schema& array(std::string name, std::string doc, std::function<Schema()> element);

  /// Reads the file, then the overrides ("key=value", value in TOML or a bare word).
  /// Array elements are addressed by index or by their `name`: source.0.path.
  /// @return TOOLS_CONFIG_SYNTAX, TOOLS_CONFIG_INVALID (all findings, one a line),
  ///         TOOLS_VARIABLE_NOT_SET, CORE_FILE_*
  [[nodiscard]] Result<void> read(const std::filesystem::path& file,
                                  const std::vector<std::string>& overrides = {});

  /// The commented template with the current values.
  [[nodiscard]] std::string template_text() const;

  /// Canonical JSON of the keys that start with one of `prefixes` (all if empty);
  /// an array element counts under its array's name.
  [[nodiscard]] std::string values_json(const std::vector<std::string>& prefixes = {}) const;

 private:
  friend struct SchemaReader;
  struct Section {
    std::string name, doc;
    std::size_t first_key;
  };
  struct Array {
    std::string name, doc;
    std::function<Schema()> element;
    std::vector<Schema> elements;
  };
  std::vector<Key> keys_;
  std::vector<Section> sections_;
  std::vector<Array> arrays_;
};

}  // namespace maquette::tools
