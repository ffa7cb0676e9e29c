// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/gcode_control.hpp"

#include <array>

#include <fmt/format.h>

#include "cnc/gcode_words.hpp"

namespace maquette::cnc {
namespace {

using Kind = ControlLine::Kind;

struct Keyword {
  std::string_view text;
  Kind kind;
};
constexpr std::array<Keyword, 15> kKeywords{{{"SUB", Kind::sub},
                                             {"ENDSUB", Kind::end_sub},
                                             {"RETURN", Kind::return_},
                                             {"CALL", Kind::call},
                                             {"IF", Kind::if_},
                                             {"ELSEIF", Kind::else_if},
                                             {"ELSE", Kind::else_},
                                             {"ENDIF", Kind::end_if},
                                             {"WHILE", Kind::while_},
                                             {"ENDWHILE", Kind::end_while},
                                             {"DO", Kind::do_},
                                             {"REPEAT", Kind::repeat},
                                             {"ENDREPEAT", Kind::end_repeat},
                                             {"BREAK", Kind::break_},
                                             {"CONTINUE", Kind::continue_}}};

bool digit(char c) {
  return c >= '0' && c <= '9';
}
bool letter(char c) {
  return gcode_upper(c) >= 'A' && gcode_upper(c) <= 'Z';
}
std::size_t skip_blanks(std::string_view line, std::size_t at) {
  while (at < line.size() && gcode_blank(line[at])) ++at;
  return at;
}

}  // namespace

ControlLine control_line(std::string_view line) {
  ControlLine control;
  std::size_t at = skip_blanks(line, 0);
  if (at < line.size() && gcode_upper(line[at]) == 'N') {  // a line number may stand before
    at = skip_blanks(line, at + 1);
    while (at < line.size() && digit(line[at])) ++at;
    at = skip_blanks(line, at);
  }
  if (at >= line.size() || (gcode_upper(line[at]) != 'O' && line[at] != ':')) return control;
  control.column = at + 1;
  control.kind = Kind::unknown;
  const bool colon = line[at] == ':';
  at = skip_blanks(line, at + 1);
  if (at < line.size() && line[at] == '<') {
    const std::size_t close = line.find('>', at);
    if (close == std::string_view::npos) return control;
    control.label.assign(1, '<');
    for (const char c : line.substr(at + 1, close - at - 1))
      if (!gcode_blank(c))
        control.label += c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
    control.label += '>';
    at = close + 1;
  } else {
    while (at < line.size() && digit(line[at])) {
      if (control.label == "0") control.label.clear();
      control.label += line[at++];
    }
    if (control.label.empty()) return control;
  }
  at = skip_blanks(line, at);
  std::string word;
  while (at < line.size() && letter(line[at])) word += gcode_upper(line[at++]);
  control.after = at;
  if (word.empty() && control.label[0] != '<') {
    control.kind = Kind::program;
  } else if (!colon) {
    for (const Keyword& k : kKeywords)
      if (k.text == word) control.kind = k.kind;
  }
  return control;
}

std::string_view end_of(Kind kind) {
  switch (kind) {
    case Kind::sub:
      return "endsub";
    case Kind::if_:
      return "endif";
    case Kind::while_:
      return "endwhile";
    case Kind::do_:
      return "while";
    case Kind::repeat:
      return "endrepeat";
    default:
      return "its end";
  }
}

std::optional<ControlFault> match(std::vector<KeptLine>& lines) {
  struct Open {
    std::size_t head, branch;  // the last branch of an if
    std::vector<std::size_t> branches, jumps;
  };
  std::vector<Open> open;
  const auto fault = [&](std::size_t i, std::string text) {
    return ControlFault{lines[i].number, lines[i].control.column, std::move(text)};
  };
  const auto names_open = [&](std::size_t i) {
    return !open.empty() && lines[open.back().head].control.label == lines[i].control.label;
  };
  for (std::size_t i = 0; i < lines.size(); ++i) {
    const ControlLine& control = lines[i].control;
    const Kind head = open.empty() ? Kind::none : lines[open.back().head].control.kind;
    switch (control.kind) {
      case Kind::none:
      case Kind::program:
      case Kind::return_:
      case Kind::call:
        break;
      case Kind::unknown:
        // An expression as label: only "call" can have it, and it jumps nowhere here.
        break;
      case Kind::sub:
        if (i != 0)
          return fault(i, "found a sub inside of another block, expected that to end first");
        open.push_back({i, i, {}, {}});
        break;
      case Kind::if_:
      case Kind::do_:
      case Kind::repeat:
        open.push_back({i, i, {i}, {}});
        break;
      case Kind::while_:
        if (head == Kind::do_ && names_open(i)) {
          for (const std::size_t jump : open.back().jumps) lines[jump].partner = i;
          lines[open.back().head].partner = i;
          lines[i].partner = open.back().head;
          lines[i].end = 1;  // the end of a do, not a head
          open.pop_back();
        } else {
          open.push_back({i, i, {}, {}});
        }
        break;
      case Kind::else_if:
      case Kind::else_:
        if (head != Kind::if_ || !names_open(i))
          return fault(i, fmt::format("found a branch without its if, expected o{} if before",
                                      control.label));
        lines[open.back().branch].partner = i;
        open.back().branch = i;
        open.back().branches.push_back(i);
        break;
      case Kind::end_sub:
      case Kind::end_if:
      case Kind::end_while:
      case Kind::end_repeat: {
        const Kind wanted = control.kind == Kind::end_sub     ? Kind::sub
                            : control.kind == Kind::end_if    ? Kind::if_
                            : control.kind == Kind::end_while ? Kind::while_
                                                              : Kind::repeat;
        if (head != wanted || !names_open(i))
          return fault(i,
                       fmt::format("found {} without its beginning, expected {}", end_of(wanted),
                                   open.empty() ? std::string("its head before")
                                                : fmt::format("o{} {} first",
                                                              lines[open.back().head].control.label,
                                                              end_of(head))));
        for (const std::size_t jump : open.back().jumps) lines[jump].partner = i;
        for (const std::size_t branch : open.back().branches) lines[branch].end = i;
        lines[open.back().branch].partner = i;
        lines[i].partner = open.back().head;
        open.pop_back();
        break;
      }
      case Kind::break_:
      case Kind::continue_: {
        auto loop = open.rbegin();
        while (loop != open.rend() && (lines[loop->head].control.kind == Kind::if_ ||
                                       lines[loop->head].control.label != control.label))
          ++loop;
        if (loop == open.rend() || lines[loop->head].control.kind == Kind::sub)
          return fault(i, fmt::format("found break or continue outside of a loop o{}, expected it "
                                      "inside",
                                      control.label));
        loop->jumps.push_back(i);
        break;
      }
    }
  }
  if (!open.empty())
    return fault(open.back().head, fmt::format("found a block that does not end, expected o{} {}",
                                               lines[open.back().head].control.label,
                                               end_of(lines[open.back().head].control.kind)));
  return std::nullopt;
}

}  // namespace maquette::cnc
