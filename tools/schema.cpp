// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/schema.hpp"

#include <algorithm>
#include <cstdlib>
#include <optional>
#include <set>

#include <fmt/format.h>
#include <toml++/toml.h>
#include <nlohmann/json.hpp>

#include "core/files.hpp"
#include "tools/schema_text.hpp"

namespace maquette::tools {
namespace fs = std::filesystem;
namespace {

template <class... F>
struct Overloaded : F... {
  using F::operator()...;
};
template <class... F>
Overloaded(F...) -> Overloaded<F...>;

std::string number_text(double v) {
  std::string text = fmt::format("{}", v);
  if (text.find_first_of(".en") == std::string::npos) text += ".0";
  return text;
}

std::string quoted(const std::string& s) {
  std::string out = "\"";
  for (const char c : s) {
    if (c == '"' || c == '\\') out += '\\';
    out += c;
  }
  return out + '"';
}

template <class T, class F>
std::string list_text(const std::vector<T>& values, F text) {
  std::string out = "[";
  for (std::size_t i = 0; i < values.size(); ++i) out += (i == 0 ? "" : ", ") + text(values[i]);
  return out + "]";
}

std::vector<double> numbers(const Vec3& v) {
  return {v.x, v.y, v.z};
}
std::vector<double> numbers(const Quaternion& q) {
  return {q.w, q.x, q.y, q.z};
}

std::string value_text(const Target& target) {
  return std::visit(
      Overloaded{[](const double* v) { return number_text(*v); },
                 [](const std::int64_t* v) { return fmt::format("{}", *v); },
                 [](const bool* v) { return std::string(*v ? "true" : "false"); },
                 [](const std::string* v) { return quoted(*v); },
                 [](const fs::path* v) { return quoted(v->string()); },
                 [](const std::vector<double>* v) { return list_text(*v, number_text); },
                 [](const std::vector<std::string>* v) { return list_text(*v, quoted); },
                 [](const std::vector<fs::path>* v) {
                   return list_text(*v, [](const fs::path& p) { return quoted(p.string()); });
                 },
                 [](const Vec3* v) { return list_text(numbers(*v), number_text); },
                 [](const Quaternion* v) { return list_text(numbers(*v), number_text); }},
      target);
}

nlohmann::json value_json(const Target& target) {
  return std::visit(Overloaded{[](const fs::path* v) { return nlohmann::json(v->string()); },
                               [](const std::vector<fs::path>* v) {
                                 nlohmann::json list = nlohmann::json::array();
                                 for (const fs::path& p : *v) list.push_back(p.string());
                                 return list;
                               },
                               [](const Vec3* v) { return nlohmann::json(numbers(*v)); },
                               [](const Quaternion* v) { return nlohmann::json(numbers(*v)); },
                               [](const auto* v) { return nlohmann::json(*v); }},
                    target);
}

std::string type_name(const Target& target) {
  return std::visit(
      Overloaded{[](const double*) { return "a number"; },
                 [](const std::int64_t*) { return "a whole number"; },
                 [](const bool*) { return "true or false"; },
                 [](const std::string*) { return "a string"; },
                 [](const fs::path*) { return "a path (string)"; },
                 [](const std::vector<double>*) { return "a list of numbers"; },
                 [](const std::vector<std::string>*) { return "a list of strings"; },
                 [](const std::vector<fs::path>*) { return "a path or a list of paths"; },
                 [](const Vec3*) { return "three numbers"; },
                 [](const Quaternion*) { return "four numbers (w, x, y, z)"; }},
      target);
}

std::string allowed_text(const Key& key) {
  std::string text = type_name(key.target);
  if (!key.choices.empty()) return text + fmt::format(": {}", fmt::join(key.choices, ", "));
  if (std::isfinite(key.min) && std::isfinite(key.max))
    return text + fmt::format(", {} to {}", key.min, key.max);
  if (std::isfinite(key.min)) return text + fmt::format(", at least {}", key.min);
  if (std::isfinite(key.max)) return text + fmt::format(", at most {}", key.max);
  return text;
}

}  // namespace

/// One pass over one file or one override, collecting what is wrong.
struct SchemaReader {
  std::string place;  ///< "site.toml" or "--set"
  fs::path folder;    ///< paths are relative to it
  std::vector<std::string> findings;
  bool missing_variable = false;

  void complain(const toml::node& node, const std::string& what) {
    const auto line = node.source().begin.line;
    findings.push_back(line > 0 && place != "--set" ? fmt::format("{}:{}: {}", place, line, what)
                                                    : fmt::format("{}: {}", place, what));
  }

  bool in_range(const toml::node& node, const Key& key, double v, const std::string& name) {
    if (v >= key.min && v <= key.max && std::isfinite(v)) return true;
    complain(node, fmt::format("key '{}' is {}; allowed is {}", name, v, allowed_text(key)));
    return false;
  }

  bool is_choice(const toml::node& node, const Key& key, const std::string& v,
                 const std::string& name) {
    if (key.choices.empty() ||
        std::find(key.choices.begin(), key.choices.end(), v) != key.choices.end())
      return true;
    const std::string near = nearest_name(v, key.choices);
    complain(node, fmt::format("key '{}' is \"{}\"; allowed is {}{}", name, v, allowed_text(key),
                               near.empty() ? "" : fmt::format("; did you mean \"{}\"?", near)));
    return false;
  }

  /// ${NAME} and ${NAME:-default}
  std::string expand(const toml::node& node, const std::string& text, const std::string& name) {
    std::string out;
    std::size_t at = 0;
    while (at < text.size()) {
      const std::size_t open = text.find("${", at);
      const std::size_t close = open == std::string::npos ? open : text.find('}', open);
      if (close == std::string::npos) return out + text.substr(at);
      out += text.substr(at, open - at);
      const std::string inside = text.substr(open + 2, close - open - 2);
      const std::size_t dash = inside.find(":-");
      const std::string variable = inside.substr(0, dash);
      const char* value = std::getenv(variable.c_str());
      if (value != nullptr && *value != '\0') {
        out += value;
      } else if (dash != std::string::npos) {
        out += inside.substr(dash + 2);
      } else {
        missing_variable = true;
        complain(node, fmt::format("key '{}' needs the environment variable {}, which is not set; "
                                   "set it or give the path with --set {}=PATH",
                                   name, variable, name));
      }
      at = close + 1;
    }
    return out;
  }

  /// Assigns one value or says why not.
  void assign(const Key& key, const toml::node& node, const std::string& name) {
    const auto wrong_type = [&] {
      complain(node, fmt::format("key '{}' must be {}", name, allowed_text(key)));
    };
    const auto number_list = [&](std::size_t count, auto&& use) {
      const toml::array* a = node.as_array();
      std::vector<double> values;
      if (a != nullptr)
        for (const toml::node& e : *a) {
          const auto v = e.value<double>();
          if (!v || !e.is_number()) break;
          if (!in_range(e, key, *v, name)) return;
          values.push_back(*v);
        }
      if (a == nullptr || values.size() != a->size() || (count > 0 && values.size() != count) ||
          values.empty())
        return wrong_type();
      use(values);
    };
    const auto path_of = [&](const toml::node& n) -> std::optional<fs::path> {
      const auto v = n.value<std::string>();
      if (!v || !n.is_string() || v->empty()) {
        wrong_type();
        return std::nullopt;
      }
      const fs::path path = expand(n, *v, name);
      return path.is_absolute() ? path : folder / path;
    };
    std::visit(
        Overloaded{
            [&](double* to) {
              const auto v = node.value<double>();
              if (!v || !node.is_number()) return wrong_type();
              if (in_range(node, key, *v, name)) *to = *v;
            },
            [&](std::int64_t* to) {
              const auto v = node.value<std::int64_t>();
              if (!v || !node.is_integer()) return wrong_type();
              if (in_range(node, key, static_cast<double>(*v), name)) *to = *v;
            },
            [&](bool* to) {
              const auto v = node.value<bool>();
              if (!v || !node.is_boolean()) return wrong_type();
              *to = *v;
            },
            [&](std::string* to) {
              const auto v = node.value<std::string>();
              if (!v || !node.is_string()) return wrong_type();
              if (is_choice(node, key, *v, name)) *to = *v;
            },
            [&](fs::path* to) {
              if (const auto path = path_of(node)) *to = *path;
            },
            [&](std::vector<fs::path>* to) {
              std::vector<fs::path> values;
              const toml::array* a = node.as_array();
              for (std::size_t i = 0; i < (a == nullptr ? 1 : a->size()); ++i) {
                const auto path = path_of(a == nullptr ? node : (*a)[i]);
                if (!path) return;
                values.push_back(*path);
              }
              *to = values;
            },
            [&](std::vector<double>* to) {
              number_list(0, [&](const std::vector<double>& v) { *to = v; });
            },
            [&](std::vector<std::string>* to) {
              const toml::array* a = node.as_array();
              std::vector<std::string> values;
              if (a == nullptr) return wrong_type();
              for (const toml::node& e : *a) {
                const auto v = e.value<std::string>();
                if (!v || !e.is_string()) return wrong_type();
                if (!is_choice(e, key, *v, name)) return;
                values.push_back(*v);
              }
              *to = values;
            },
            [&](Vec3* to) {
              number_list(3, [&](const std::vector<double>& v) { *to = {v[0], v[1], v[2]}; });
            },
            [&](Quaternion* to) {
              number_list(4, [&](const std::vector<double>& v) { *to = {v[0], v[1], v[2], v[3]}; });
            }},
        key.target);
  }

  static std::vector<std::string> known_names(const Schema& schema) {
    std::vector<std::string> names;
    for (const Key& k : schema.keys_) names.push_back(k.name);
    for (const auto& a : schema.arrays_) names.push_back(a.name);
    return names;
  }

  static bool is_section(const Schema& schema, const std::string& name) {
    return std::any_of(schema.keys_.begin(), schema.keys_.end(),
                       [&](const Key& k) { return k.name.starts_with(name + "."); });
  }

  void unknown(const Schema& schema, const toml::node& node, const std::string& name,
               const std::string& shown) {
    std::vector<std::string> names = known_names(schema);
    for (const auto& s : schema.sections_)
      if (!s.name.empty()) names.push_back(s.name);
    const std::string near = nearest_name(name, names);
    complain(node,
             fmt::format("unknown key '{}'{}", shown,
                         near.empty() ? fmt::format("; known here: {}", fmt::join(names, ", "))
                                      : fmt::format("; did you mean '{}'?", near)));
  }

  /// @param inside  dotted name of `table` within the schema, "" at the top
  /// @param shown   prefix for messages, e.g. "source[0]."
  void table(Schema& schema, const toml::table& t, const std::string& inside,
             const std::string& shown, std::set<std::string>& seen) {
    for (const auto& [key_text, node] : t) {
      const std::string name =
          inside.empty() ? std::string(key_text.str()) : inside + "." + std::string(key_text.str());
      const auto key = std::find_if(schema.keys_.begin(), schema.keys_.end(),
                                    [&](const Key& k) { return k.name == name; });
      if (key != schema.keys_.end()) {
        seen.insert(name);
        assign(*key, node, shown + name);
        continue;
      }
      const auto array = std::find_if(schema.arrays_.begin(), schema.arrays_.end(),
                                      [&](const Schema::Array& a) { return a.name == name; });
      if (array != schema.arrays_.end()) {
        this->array(*array, node, shown + name);
        continue;
      }
      if (node.is_table() && is_section(schema, name)) {
        table(schema, *node.as_table(), name, shown, seen);
        continue;
      }
      unknown(schema, node, name, shown + name);
    }
  }

  void array(Schema::Array& array, const toml::node& node, const std::string& shown) {
    const toml::array* list = node.as_array();
    if (list == nullptr || !list->is_homogeneous(toml::node_type::table)) {
      complain(node, fmt::format("'{0}' must be written as [[{0}]] tables", shown));
      return;
    }
    for (const toml::node& e : *list) {
      array.elements.push_back(array.element());
      Schema& element = array.elements.back();
      std::set<std::string> seen;
      const std::string prefix = fmt::format("{}[{}].", shown, array.elements.size() - 1);
      table(element, *e.as_table(), "", prefix, seen);
      required(element, seen, e, prefix);
    }
  }

  void required(const Schema& schema, const std::set<std::string>& seen, const toml::node& node,
                const std::string& shown) {
    for (const Key& k : schema.keys_)
      if (k.required && !seen.contains(k.name))
        complain(node, fmt::format("key '{}{}' is missing: {} ({})", shown, k.name, k.doc,
                                   allowed_text(k)));
  }

  /// source.0.path or source.hirise.path
  Schema* element(Schema& schema, std::string& name) {
    for (Schema::Array& a : schema.arrays_) {
      if (!name.starts_with(a.name + ".")) continue;
      const std::size_t start = a.name.size() + 1;
      const std::size_t dot = name.find('.', start);
      if (dot == std::string::npos) return nullptr;
      const std::string which = name.substr(start, dot - start);
      for (std::size_t i = 0; i < a.elements.size(); ++i) {
        bool match = which == fmt::format("{}", i);
        for (const Key& k : a.elements[i].keys_)
          if (k.name == "name" && std::holds_alternative<std::string*>(k.target))
            match |= *std::get<std::string*>(k.target) == which;
        if (match) {
          name = name.substr(dot + 1);
          return &a.elements[i];
        }
      }
    }
    return nullptr;
  }

  static Result<void> read(Schema& schema, const std::string& text, const std::string& place,
                           const fs::path& folder, const std::vector<std::string>& overrides);

  void override_one(Schema& schema, const std::string& text) {
    const std::size_t equals = text.find('=');
    if (equals == std::string::npos || equals == 0) {
      findings.push_back(fmt::format("--set {}: expected key=value", text));
      return;
    }
    std::string name = text.substr(0, equals);
    const std::string value = text.substr(equals + 1);
    const std::string shown = name;
    Schema* holder = element(schema, name);
    if (holder == nullptr) holder = &schema;
    toml::table parsed;
    try {
      parsed = toml::parse("value = " + value);
    } catch (const toml::parse_error&) {
      parsed.insert("value", value);  // a bare word is a string
    }
    const toml::node& node = *parsed.get("value");
    const auto key = std::find_if(holder->keys_.begin(), holder->keys_.end(),
                                  [&](const Key& k) { return k.name == name; });
    if (key == holder->keys_.end()) return unknown(*holder, node, name, shown);
    assign(*key, node, shown);
  }
};

Schema& Schema::add(Key key) {
  keys_.push_back(std::move(key));
  return *this;
}

Schema& Schema::section(std::string name, std::string doc) {
  sections_.push_back({std::move(name), std::move(doc), keys_.size()});
  return *this;
}

Schema& Schema::array(std::string name, std::string doc, std::function<Schema()> element) {
  arrays_.push_back({std::move(name), std::move(doc), std::move(element), {}});
  return *this;
}

Result<void> Schema::read(const fs::path& file, const std::vector<std::string>& overrides) {
  constexpr std::size_t kLargestConfiguration = 16 << 20;
  MAQUETTE_TRY(const std::string text, read_file(file, kLargestConfiguration));
  return read_schema_text(*this, text, file.string(), fs::absolute(file).parent_path(), overrides);
}

Result<void> SchemaReader::read(Schema& schema, const std::string& text, const std::string& place,
                                const fs::path& folder, const std::vector<std::string>& overrides) {
  SchemaReader reader;
  reader.place = place;
  reader.folder = folder;
  try {
    const toml::table table = toml::parse(text, place);
    std::set<std::string> seen;
    reader.table(schema, table, "", "", seen);
    for (const std::string& o : overrides) seen.insert(o.substr(0, o.find('=')));
    reader.required(schema, seen, table, "");
  } catch (const toml::parse_error& e) {
    return fail(kConfigSyntax,
                fmt::format("{}:{}:{}: not valid TOML: {}", place, e.source().begin.line,
                            e.source().begin.column, e.description()));
  }
  reader.place = "--set";
  reader.folder = fs::current_path();
  for (const std::string& o : overrides) reader.override_one(schema, o);
  // A source that --set names makes the variable it replaces unnecessary.
  if (reader.missing_variable && !overrides.empty())
    std::erase_if(reader.findings, [&](const std::string& f) {
      return std::any_of(overrides.begin(), overrides.end(), [&](const std::string& o) {
        std::string name = o.substr(0, o.find('='));
        const std::string last = name.substr(name.rfind('.') + 1);
        Schema* holder = reader.element(schema, name);
        if (holder == nullptr || f.find("environment variable") == std::string::npos) return false;
        for (const Schema::Array& a : schema.arrays_)
          for (std::size_t i = 0; i < a.elements.size(); ++i)
            if (&a.elements[i] == holder &&
                f.find(fmt::format("'{}[{}].{}'", a.name, i, last)) != std::string::npos)
              return true;
        return false;
      });
    });
  if (!reader.findings.empty())
    return fail(reader.missing_variable ? kVariableNotSet : kConfigInvalid,
                fmt::format("{}", fmt::join(reader.findings, "\n")));
  return {};
}

Result<void> read_schema_text(Schema& schema, const std::string& text, const std::string& place,
                              const fs::path& folder, const std::vector<std::string>& overrides) {
  return SchemaReader::read(schema, text, place, folder, overrides);
}

std::string Schema::template_text() const {
  std::string out;
  std::string inside;
  std::size_t next_section = 0;
  for (std::size_t i = 0; i < keys_.size(); ++i) {
    while (next_section < sections_.size() && sections_[next_section].first_key == i) {
      const Section& s = sections_[next_section++];
      out += fmt::format("\n# {}\n", s.doc);
      if (!s.name.empty()) out += fmt::format("[{}]\n", s.name);
      inside = s.name;
    }
    const Key& k = keys_[i];
    const std::string name = inside.empty() ? k.name : k.name.substr(inside.size() + 1);
    std::string allowed = allowed_text(k);
    const auto* path = std::get_if<fs::path*>(&k.target);
    const auto* list = std::get_if<std::vector<double>*>(&k.target);
    // No file may be named so, and a list that is given has a number.
    const bool none =
        (path != nullptr && (*path)->empty()) || (list != nullptr && (*list)->empty());
    out += fmt::format("{}{} = {}  # {} ({})\n", none ? "# " : "", name, value_text(k.target),
                       k.doc, allowed);
  }
  for (const Array& a : arrays_) {
    out += fmt::format("\n# {}\n", a.doc);
    const Schema element = a.element();
    out += fmt::format("# [[{}]]\n", a.name);
    for (const Key& k : element.keys_) {
      const auto* number = std::get_if<double*>(&k.target);
      const bool unset = number != nullptr && std::isnan(**number);
      out += fmt::format("# {} = {}  # {} ({})\n", k.name, unset ? "" : value_text(k.target), k.doc,
                         allowed_text(k));
    }
  }
  return out;
}

std::string Schema::values_json(const std::vector<std::string>& prefixes) const {
  nlohmann::json out = nlohmann::json::object();
  const auto wanted = [&](const std::string& name) {
    return prefixes.empty() || std::any_of(prefixes.begin(), prefixes.end(),
                                           [&](const auto& p) { return name.starts_with(p); });
  };
  for (const Key& k : keys_)
    if (wanted(k.name)) out[k.name] = value_json(k.target);
  for (const Array& a : arrays_) {
    if (!wanted(a.name)) continue;
    nlohmann::json list = nlohmann::json::array();
    for (const Schema& e : a.elements) list.push_back(nlohmann::json::parse(e.values_json()));
    out[a.name] = list;
  }
  return out.dump();
}

}  // namespace maquette::tools
