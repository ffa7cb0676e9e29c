// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file program_pictures.hpp
/// Pictures of programs while they are read or cut: each program from above by feed, by engagement
/// or by height; of all of them the paths for the view in three dimensions (path_view.hpp).
///
/// A program of a band has millions of moves. The picture holds the density as an image, whose
/// pixels are means of the path in them, and as lines only what is few: outline, rapids, where cuts
/// begin. The view holds the path thinned (cnc/path_sketch.hpp), and says how far.
/// Memory: one program's picture at a time, and the thinned paths.

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "cnc/backplot.hpp"
#include "cnc/gcode_reader.hpp"
#include "core/result.hpp"
#include "heightmap/height_field.hpp"
#include "tools/drawing.hpp"

namespace maquette::tools {

struct ProgramFigures {
  std::uint64_t moves = 0;
  double cut_mm = 0.0, rapid_mm = 0.0, time_min = 0.0;  ///< at the programmed feed
  double lowest_mm = INFINITY, highest_mm = -INFINITY;  ///< of the tip, cutting
};

struct ProgramPicturesOptions {
  const heightmap::ModelField* design = nullptr;  ///< its outline, and the ground of the view
  std::vector<cnc::BackplotColour> colours{cnc::BackplotColour::feed};
  bool together = false;            ///< all programs in one picture, not one each
  bool engagement = false;          ///< `add` is told what each motion removed
  std::size_t most_points = 40000;  ///< of all programs in the view together
};

/// Gets each picture when its program is done; `program` is a name for files, different for each.
using PictureSink = std::function<Result<void>(const std::string& program,
                                               cnc::BackplotColour colour, const Drawing& drawing)>;

class ProgramPictures {
 public:
  /// Reads the programs once, for their size. @return what read_gcode() returns
  [[nodiscard]] static Result<ProgramPictures> plan(std::span<const std::filesystem::path> programs,
                                                    const ProgramPicturesOptions& options,
                                                    PictureSink sink);
  ProgramPictures(ProgramPictures&&) noexcept;
  ~ProgramPictures();

  /// Motions of one program after the other, in the order of plan().
  void add(const cnc::Motion& motion, std::size_t program, double removed_mm3 = 0.0);

  /// Call once, after the last add. @return what the sink returned first
  [[nodiscard]] Result<void> finish();
  [[nodiscard]] ProgramFigures figures() const;  ///< of all programs together
  /// After finish(): the scene of the view.
  [[nodiscard]] std::string scene_json() const;

 private:
  struct State;
  explicit ProgramPictures(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

/// Writes <folder>/<program>.<colour>.svg and .png and adds their names to `files`, which outlives
/// the sink. The folder is made when there is something to put into it.
[[nodiscard]] PictureSink picture_files(const std::filesystem::path& folder,
                                        std::vector<std::filesystem::path>& files);

/// "feed", "engagement", "height"
[[nodiscard]] const char* name(cnc::BackplotColour colour);

/// A box in the model's frame.
struct Outline {
  double x_min_mm = 0.0, x_max_mm = 0.0, y_min_mm = 0.0, y_max_mm = 0.0;
};
/// @param rapids_deviation_mm  0: all rapids are there
/// The whole picture: title, figures, path, frame in millimetres, scale of the colours, legend.
[[nodiscard]] Drawing backplot_drawing(const cnc::Backplot& plot, cnc::BackplotColour colour,
                                       const std::vector<std::vector<Vec3>>& rapids,
                                       double rapids_deviation_mm, const std::string& title,
                                       const ProgramFigures& figures,
                                       const std::optional<Outline>& outline);

}  // namespace maquette::tools
