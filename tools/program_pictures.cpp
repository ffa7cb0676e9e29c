// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/program_pictures.hpp"

#include <algorithm>
#include <cmath>
#include <set>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "cnc/path_sketch.hpp"
#include "core/vec.hpp"
#include "tools/path_view.hpp"

namespace maquette::tools {
namespace fs = std::filesystem;
using cnc::BackplotColour;
using cnc::Motion;
namespace {

// Of the longest side: thinning of the view, of rapids in a picture, segments in one colour.
constexpr double kViewCells = 150.0, kRapidCells = 25.0, kSegments = 60.0;
constexpr std::size_t kRapidPoints = 2000, kLeastPoints = 2000;
constexpr std::size_t kFewRapids = 400;  // are all drawn
constexpr double kLongestPixels = 1400.0, kPixels = 7e5;

struct Program {
  std::string name;
  Box3 cuts;  // and rapids where nothing is cut
  ProgramFigures figures;
  std::size_t sections = 1;  // of one tool each
};

/// What one tool does of a program, one after the other.
struct Section {
  std::size_t program = 0;
  int tool = 0;
  ProgramFigures figures{};
  cnc::Sketch sketch{};
};

struct Picture {
  std::string name;
  Box3 cuts;
  ProgramFigures figures;
  std::optional<cnc::Backplot> plot;
  std::optional<cnc::PathSketch> rapids;
  std::vector<std::vector<Vec3>> few_rapids;
};

cnc::BackplotOptions window_of(const Box3& cuts) {
  cnc::BackplotOptions window;
  if (cuts.empty()) return window;
  const Vec3 size = cuts.max - cuts.min;
  const double margin = std::fmax(0.02 * std::fmax(size.x, size.y), 1e-3);
  window = {cuts.min.x - margin, cuts.max.x + margin, cuts.min.y - margin, cuts.max.y + margin};
  // A cut along one line has a picture too.
  const double least = 0.1 * std::fmax(size.x, size.y);
  const auto widen = [&](double& low, double& high) {
    const double more = 0.5 * std::fmax(0.0, least - (high - low));
    low -= more;
    high += more;
  };
  widen(window.x_min_mm, window.x_max_mm);
  widen(window.y_min_mm, window.y_max_mm);
  const double width = window.x_max_mm - window.x_min_mm,
               height = window.y_max_mm - window.y_min_mm;
  const double longest = std::fmax(width, height);
  window.longest_px =
      static_cast<int>(std::fmin(kLongestPixels, longest * std::sqrt(kPixels / (width * height))));
  return window;
}

/// Its extent, and how many times it goes on with another tool.
Result<Box3> size_of(const fs::path& program, std::size_t& sections) {
  Box3 cuts, all;
  int tool = -1;
  sections = 0;
  const cnc::MotionSink sink = [&](std::span<const Motion> motions) -> Result<void> {
    for (const Motion& m : motions) {
      if (m.kind != Motion::Kind::rapid && m.tool != tool) {
        tool = m.tool;
        ++sections;
      }
      for (Box3* box : {&all, m.kind == Motion::Kind::rapid ? nullptr : &cuts}) {
        if (box == nullptr) continue;
        box->add(m.from_mm);
        if (m.kind == Motion::Kind::arc)
          cnc::for_each_chord(m, 0.05, [&](Vec3, Vec3 to) { box->add(to); });
        box->add(m.to_mm);
      }
    }
    return {};
  };
  MAQUETTE_TRY_VOID(cnc::read_gcode(program, sink));
  return cuts.empty() ? all : cuts;
}

}  // namespace

struct ProgramPictures::State {
  ProgramPicturesOptions o;
  std::vector<Program> programs;
  std::vector<Section> sections;
  double longest_mm = 1.0;
  std::optional<Outline> outline;
  std::size_t current = 0;
  Box3 all;
  Picture picture;  // of the current program, or of all
  std::optional<cnc::PathSketch> sketch;
  PictureSink sink;
  Result<void> status{};

  void open_picture(const std::string& title, const Box3& cuts);
  void close_picture();
  void begin(std::size_t program, int tool);
  void begin_section(int tool);
  void end_section();
  void end();
};

ProgramPictures::ProgramPictures(std::unique_ptr<State> state) : state_(std::move(state)) {}
ProgramPictures::ProgramPictures(ProgramPictures&&) noexcept = default;
ProgramPictures::~ProgramPictures() = default;

Result<ProgramPictures> ProgramPictures::plan(std::span<const fs::path> programs,
                                              const ProgramPicturesOptions& options,
                                              PictureSink sink) {
  auto state = std::make_unique<State>();
  state->o = options;
  state->sink = std::move(sink);
  std::set<std::string> names;
  Box3& all = state->all;
  for (const fs::path& path : programs) {
    Program program;
    program.name = path.stem().string();
    for (int k = 2; !names.insert(program.name).second; ++k)
      program.name = fmt::format("{}_{}", path.stem().string(), k);
    MAQUETTE_TRY(program.cuts, size_of(path, program.sections));
    if (!program.cuts.empty()) {
      all.add(program.cuts.min);
      all.add(program.cuts.max);
    }
    state->programs.push_back(std::move(program));
  }
  if (options.design != nullptr) {
    const auto& d = *options.design;
    state->outline =
        Outline{d.x0.value(), d.x_mm(d.z_mm.cols() - 1), d.y0.value(), d.y_mm(d.z_mm.rows() - 1)};
  }
  if (!all.empty())
    state->longest_mm = std::fmax(
        1e-3,
        std::fmax(all.max.z - all.min.z, std::fmax(all.max.x - all.min.x, all.max.y - all.min.y)));
  return ProgramPictures(std::move(state));
}

void ProgramPictures::State::open_picture(const std::string& title, const Box3& cuts) {
  picture = {title, cuts, {}, {}, {}, {}};
  const cnc::BackplotOptions window = window_of(cuts);
  picture.plot.emplace(window);
  const double longest =
      std::fmax(window.x_max_mm - window.x_min_mm, window.y_max_mm - window.y_min_mm);
  picture.rapids.emplace(
      cnc::SketchOptions{.cell_mm = longest / kRapidCells, .most_points = kRapidPoints});
}

void ProgramPictures::State::close_picture() {
  std::vector<std::vector<Vec3>> lines;
  double deviation = 0.0;
  if (picture.few_rapids.size() <= kFewRapids) {
    lines = std::move(picture.few_rapids);
  } else {
    const cnc::Sketch thin = picture.rapids->finish();
    deviation = thin.deviation_mm;
    for (const cnc::SketchRun& run : thin.runs) {
      lines.emplace_back();
      for (const cnc::SketchPoint& point : run.points) lines.back().push_back(point.at_mm);
    }
  }
  for (const BackplotColour colour : o.colours)
    if (status)
      status = sink(picture.name, colour,
                    backplot_drawing(*picture.plot, colour, lines, deviation, picture.name,
                                     picture.figures, outline));
}

void ProgramPictures::State::begin_section(int tool) {
  sections.push_back({current, tool});
  std::size_t count = 0;
  for (const Program& p : programs) count += std::max<std::size_t>(1, p.sections);
  sketch.emplace(cnc::SketchOptions{.cell_mm = longest_mm / kViewCells,
                                    .most_points = std::max(kLeastPoints, o.most_points / count),
                                    .longest_mm = longest_mm / kSegments});
}

void ProgramPictures::State::end_section() {
  sections.back().sketch = sketch->finish();
  sketch.reset();
}

void ProgramPictures::State::begin(std::size_t program, int tool) {
  current = program;
  begin_section(tool);
  if (!o.together)
    open_picture(programs[program].name, programs[program].cuts);
  else if (!picture.plot)
    open_picture(programs.size() == 1
                     ? programs[0].name
                     : fmt::format("{} and {} more", programs[0].name, programs.size() - 1),
                 all);
}

void ProgramPictures::State::end() {
  if (!sketch) return;
  end_section();
  if (!o.together) close_picture();
}

void ProgramPictures::add(const Motion& motion, std::size_t program, double removed_mm3) {
  State& s = *state_;
  if (!s.sketch || s.current != program) {
    s.end();
    s.begin(program, motion.tool);
  } else if (motion.kind != Motion::Kind::rapid && motion.tool != s.sections.back().tool) {
    // The way to the first cut is the next tool's.
    if (s.sections.back().figures.cut_mm > 0.0) {
      s.end_section();
      s.begin_section(motion.tool);
    }
    s.sections.back().tool = motion.tool;
  }
  const double length = length_mm(motion);
  for (ProgramFigures* f :
       {&s.picture.figures, &s.programs[program].figures, &s.sections.back().figures}) {
    ++f->moves;
    if (motion.kind == Motion::Kind::rapid) {
      f->rapid_mm += length;
      continue;
    }
    f->cut_mm += length;
    f->time_min += length / motion.feed_mm_min;
    f->lowest_mm = std::fmin(f->lowest_mm, std::fmin(motion.from_mm.z, motion.to_mm.z));
    f->highest_mm = std::fmax(f->highest_mm, std::fmax(motion.from_mm.z, motion.to_mm.z));
  }
  if (motion.kind == Motion::Kind::rapid) {
    s.picture.rapids->add(motion);
    if (s.picture.few_rapids.size() <= kFewRapids)
      s.picture.few_rapids.push_back({motion.from_mm, motion.to_mm});
  }
  s.picture.plot->add(motion, removed_mm3);
  s.sketch->add(motion, removed_mm3);
}

Result<void> ProgramPictures::finish() {
  State& s = *state_;
  s.end();
  if (s.o.together && s.picture.plot) s.close_picture();
  return s.status;
}

ProgramFigures ProgramPictures::figures() const {
  ProgramFigures sum;
  for (const Program& p : state_->programs) {
    sum.moves += p.figures.moves;
    sum.cut_mm += p.figures.cut_mm;
    sum.rapid_mm += p.figures.rapid_mm;
    sum.time_min += p.figures.time_min;
    sum.lowest_mm = std::fmin(sum.lowest_mm, p.figures.lowest_mm);
    sum.highest_mm = std::fmax(sum.highest_mm, p.figures.highest_mm);
  }
  return sum;
}

std::string ProgramPictures::scene_json() const {
  const State& s = *state_;
  std::vector<ViewProgram> programs;
  for (const Section& part : s.sections) {
    const Program& p = s.programs[part.program];
    // "band_01.raster" is the raster pass of a band.
    const std::string tool = p.sections > 1 ? fmt::format("T{}", part.tool) : "";
    const std::string operation = tool.empty() ? p.name.substr(p.name.rfind('.') + 1) : tool;
    programs.push_back({tool.empty() ? p.name : p.name + " " + tool, operation, part.figures.cut_mm,
                        part.figures.time_min, &part.sketch});
  }
  return path_scene_json(programs, s.o.engagement, s.o.design);
}

}  // namespace maquette::tools
