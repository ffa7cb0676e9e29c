// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file rs274_peer.hpp
/// LinuxCNC's own interpreter as a second opinion on a program; see tools/setup --peers.

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

#include <fmt/format.h>

#include "core/vec.hpp"
#include "support/peers.hpp"

namespace maquette::cnc::testing_support {

/// Where tools/setup --peers has put LinuxCNC, if it has.
inline std::optional<std::filesystem::path> linuxcnc_folder() {
  const std::filesystem::path peers = maquette::testing_support::peers_folder();
  if (!std::filesystem::exists(peers / "linuxcnc/usr/bin/rs274")) return std::nullopt;
  return peers / "linuxcnc";
}

/// A canonical motion: what LinuxCNC's motion planner is told, to four decimals.
struct CanonMotion {
  enum class Kind { traverse, feed, arc, probe };
  Kind kind = Kind::traverse;
  Vec3 from_mm, to_mm;       // where the tool is before the first motion nobody knows: zero
  double centre_mm[2] = {};  // in the plane, first and second axis
  int plane = 0;             // 0 xy, 1 zx, 2 yz
  int rotation = 0;          // of arcs: > 0 counter-clockwise, turns
  double feed_mm_min = 0.0;
  int tool = 0;
};

struct CanonProgram {
  int exit_code = -1;
  std::string messages;  ///< what it says beside "executing"
  bool ended = false;
  std::vector<CanonMotion> motions;
  std::uint64_t lines = 0;
};

inline CanonProgram read_canon(const std::filesystem::path& file) {
  CanonProgram program;
  std::ifstream in(file);
  Vec3 at{};
  double unit = 1.0, feed = 0.0;
  int plane = 0, tool = 0;
  for (std::string line; std::getline(in, line);) {
    ++program.lines;
    const std::size_t open = line.find('(');
    if (open == std::string::npos) continue;
    const std::size_t blank = line.rfind(' ', open);
    const std::string name = line.substr(blank + 1, open - blank - 1);
    double v[9] = {};
    int n = 0;
    const char* text = line.c_str() + open + 1;
    for (char* end = nullptr; n < 9; ++n, text = end + (*end == ',')) {
      v[n] = std::strtod(text, &end);
      if (end == text) break;
    }
    CanonMotion m;
    m.from_mm = at;
    m.feed_mm_min = feed;
    m.plane = plane;
    m.tool = tool;
    if (name == "USE_LENGTH_UNITS") {
      unit = line.find("INCHES") != std::string::npos ? 25.4 : 1.0;
    } else if (name == "SET_FEED_RATE") {
      feed = v[0] * unit;
    } else if (name == "SELECT_PLANE") {
      plane = line.find("_XY") != std::string::npos   ? 0
              : line.find("_XZ") != std::string::npos ? 1
                                                      : 2;
    } else if (name == "CHANGE_TOOL") {
      tool = static_cast<int>(v[0]);
    } else if (name == "PROGRAM_END") {
      program.ended = true;
    } else if (name == "STRAIGHT_TRAVERSE" || name == "STRAIGHT_FEED" || name == "STRAIGHT_PROBE") {
      m.kind = name == "STRAIGHT_FEED"    ? CanonMotion::Kind::feed
               : name == "STRAIGHT_PROBE" ? CanonMotion::Kind::probe
                                          : CanonMotion::Kind::traverse;
      at = m.to_mm = {v[0] * unit, v[1] * unit, v[2] * unit};
      program.motions.push_back(m);
    } else if (name == "ARC_FEED") {
      m.kind = CanonMotion::Kind::arc;
      m.centre_mm[0] = v[2] * unit;
      m.centre_mm[1] = v[3] * unit;
      m.rotation = static_cast<int>(v[4]);
      const double a = v[0] * unit, b = v[1] * unit, c = v[5] * unit;
      at = m.to_mm = plane == 0 ? Vec3{a, b, c} : plane == 1 ? Vec3{b, c, a} : Vec3{c, a, b};
      program.motions.push_back(m);
    }
  }
  return program;
}

/// Lets rs274 interpret the program. `scratch` is a folder for its files.
inline CanonProgram run_rs274(const std::filesystem::path& linuxcnc,
                              const std::filesystem::path& program,
                              const std::filesystem::path& scratch) {
  const std::string tools = (scratch / "tool.tbl").string();
  {
    std::ofstream table(tools);
    for (int t = 1; t < 100; ++t) table << "T" << t << " P" << t << " Z0 D6\n";
    std::ofstream variables(scratch / "test.var");
  }
  const auto out = scratch / "canon.txt", said = scratch / "said.txt";
  const std::string library = (linuxcnc / "usr/lib").string();
  // It maps its tool table into ~/.tool.mmap, which two of them at a time would share.
  const std::string command = fmt::format(
      "HOME='{7}' LD_LIBRARY_PATH='{0}:{0}/x86_64-linux-gnu' '{1}' -g -t '{2}' -v '{3}' '{4}' "
      "'{5}' >'{6}' 2>&1",
      library, (linuxcnc / "usr/bin/rs274").string(), tools, (scratch / "test.var").string(),
      program.string(), out.string(), said.string(), scratch.string());
  const int status = std::system(command.c_str());
  CanonProgram canon = read_canon(out);
  canon.exit_code = status;
  std::ostringstream messages;
  messages << std::ifstream(said).rdbuf();
  canon.messages = messages.str();
  if (canon.messages.starts_with("executing\n")) canon.messages.erase(0, 10);
  if (canon.messages == "executing") canon.messages.clear();
  return canon;
}

}  // namespace maquette::cnc::testing_support
