// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/verify.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>

#include <fmt/format.h>

#include "cnc/certificate.hpp"
#include "cnc/cutter_proof.hpp"
#include "cnc/gcode_reader.hpp"
#include "cnc/machine_run.hpp"
#include "cnc/mill.hpp"
#include "cnc/milling_sim.hpp"
#include "cnc/motion_store.hpp"
#include "cnc/stock_after.hpp"
#include "cnc/stone_clearance.hpp"
#include "cnc/tool_moves.hpp"
#include "core/files.hpp"

namespace maquette::cnc {
namespace {

// Enough to keep all threads busy, few enough that a stop is heard within a second.
constexpr std::size_t kMovesPerCut = std::size_t{1} << 18;
constexpr double kMostNodes = 3e9;
constexpr std::ptrdiff_t kBandNodes = 1280;  // rows of a band, about
constexpr std::size_t kCollisionsListed = 10;
constexpr double kReadingShare = 0.4;  // of the work, for the progress bar

/// That a control may leave the path by.
double blending_mm(const PathControl& control) {
  if (control.mode != PathControl::Mode::blend) return 0.0;
  return control.stated && control.tolerance_mm > 0.0 ? control.tolerance_mm : INFINITY;
}

struct GridPlan {
  std::ptrdiff_t per_spacing = 1, rows = 0, cols = 0;
  double cell_mm = 0.0;
};

Result<GridPlan> plan_grid(const heightmap::ModelField& design, const VerifyOptions& options) {
  double least = options.ball_diameter.value();
  if (options.tools.empty() && (!(least > 0.0) || !std::isfinite(least)))
    return fail(kToolNotPositive,
                fmt::format("ball_diameter is {} mm, expected a length above 0", least));
  if (!options.tools.empty()) least = INFINITY;
  for (const Tool& tool : options.tools) {
    const Cutter& c = tool.cutter;
    if (!(c.radius_mm > 0.0) || !std::isfinite(c.radius_mm) || !(c.corner_radius_mm >= 0.0) ||
        !(c.corner_radius_mm <= c.radius_mm))
      return fail(kToolNotPositive,
                  fmt::format("tool {} has radius {} mm and corner radius {} mm, expected a radius "
                              "above 0 and a corner of at most that",
                              tool.number, c.radius_mm, c.corner_radius_mm));
    least = std::fmin(least, 2.0 * c.radius_mm);
  }
  const double cell = options.cell.value();
  if (!(cell > 0.0) || !(cell <= 0.25 * least))
    return fail(kCellOutOfRange,
                fmt::format("cell is {} mm, expected more than 0 and at most half the smallest "
                            "cutter's radius, {} mm",
                            cell, 0.25 * least));
  const double spacing = design.spacing.value();
  if (design.z_mm.rows() < 2 || design.z_mm.cols() < 2 || !(spacing > 0.0))
    return fail(kCellOutOfRange,
                fmt::format("the design has {} x {} nodes {} mm apart, expected at least 2 x 2",
                            design.z_mm.rows(), design.z_mm.cols(), spacing));
  const heightmap::HeightRange range = heightmap::height_range(design.z_mm);
  if (range.voids > 0 || !std::isfinite(range.min) || !std::isfinite(range.max))
    return fail(kHeightNotFinite,
                fmt::format("the design has {} voids or infinite heights, expected none; fill "
                            "them first",
                            range.voids));
  // The largest fraction of the spacing that is not above the cell asked for; a hair's
  // breadth of rounding must not make 5 into 6.
  const double parts = std::fmax(1.0, std::ceil(spacing / cell * (1.0 - 1e-9)));
  const double rows = static_cast<double>(design.z_mm.rows() - 1) * parts + 1.0;
  const double cols = static_cast<double>(design.z_mm.cols() - 1) * parts + 1.0;
  if (!(rows * cols <= kMostNodes))
    return fail(kCellOutOfRange,
                fmt::format("cell {} mm asks for {:.0f} x {:.0f} nodes, {:.1f} GB; expected at "
                            "most {:.0f} nodes in all, take a larger cell or verify in bands",
                            cell, rows, cols, rows * cols * 4e-9, kMostNodes));
  GridPlan plan;
  plan.per_spacing = static_cast<std::ptrdiff_t>(parts);
  plan.rows = static_cast<std::ptrdiff_t>(rows);
  plan.cols = static_cast<std::ptrdiff_t>(cols);
  plan.cell_mm = spacing / parts;
  return plan;
}

/// One program's own hash, or that of the list of hashes.
Result<std::string> fingerprint(std::span<const std::filesystem::path> programs) {
  std::string list;
  for (const auto& program : programs) {
    MAQUETTE_TRY(const std::string one, sha256_file(program));
    if (programs.size() == 1) return one;
    list += one + "\n";
  }
  return sha256(list);
}

/// The work of one call, in the order of the member functions.
class Verifying {
 public:
  Verifying(std::span<const std::filesystem::path> programs, const heightmap::ModelField& design,
            const VerifyOptions& options, const GridPlan& plan, const RunContext& run)
      : programs_(programs), design_(design), options_(options), plan_(plan), run_(run) {
    if (options.tools.empty()) {
      cutters_.push_back(Cutter::ball(0.5 * options.ball_diameter.value()));
    }
    for (const Tool& tool : options.tools) {
      cutters_.push_back(tool.cutter);
    }
    if (options.errors) {
      machine_run_.emplace(*options.errors, options.tools, 0.5 * options.ball_diameter.value());
      // The tip stays where it is touched off; the ball above it is another one.
      for (std::size_t i = 0; i < cutters_.size(); ++i)
        if (cutters_[i].is_ball() &&
            options.errors->tool_counts(options.tools.empty() ? 0 : options.tools[i].number))
          cutters_[i].corner_radius_mm = cutters_[i].radius_mm += options.errors->radius_error_mm;
    }
    c_.ball_diameter_mm = 2.0 * cutters_.front().radius_mm;
    c_.cell_mm = plan.cell_mm;
    c_.stepover_mm = options.stepover.value();
    used_.assign(cutters_.size(), false);
    finishing_ = options.finish_tool == 0;
    if (options.with_stones != nullptr) stones_.emplace(design, *options.with_stones, cutters_);
    const double highest = static_cast<double>(heightmap::height_range(design.z_mm).max);
    top_mm_ = std::isnan(options.stock_top.value()) ? highest + 1.0 : options.stock_top.value();
    if (options.stock != nullptr) {
      const float most = heightmap::height_range(options.stock->z_mm).max;
      if (std::isfinite(most)) highest_stock_mm_ = static_cast<double>(most);
    }
    highest_stock_mm_ = std::fmax(highest_stock_mm_, top_mm_);
  }

  Result<void> check() const;
  Result<void> read();
  Result<void> prove_paths();
  Result<void> cut(const RowSink& rows);
  Result<Certificate> finish();

  void sum_up_times();

 private:
  Result<std::uint16_t> cutter_of(const Motion& motion, std::size_t program) const;
  void use(std::size_t program, int tool);
  void stop_timer();
  Result<void> take(std::span<const Motion> motions, std::size_t program);
  [[nodiscard]] CutterError error() const;
  [[nodiscard]] ComparisonOptions comparison_options() const;
  Result<void> cut_band(Comparison& comparison, std::ptrdiff_t b0, std::ptrdiff_t b1,
                        MoveEffects& effects, const RowSink& rows);
  void sum_up(const MoveEffects& effects);
  void prove_gouge();

  std::span<const std::filesystem::path> programs_;
  const heightmap::ModelField& design_;
  const VerifyOptions& options_;
  GridPlan plan_;
  const RunContext& run_;
  double top_mm_ = 0.0, highest_stock_mm_ = -INFINITY;
  std::vector<Cutter> cutters_;
  std::vector<bool> used_;
  std::uint16_t last_cutter_ = 0;
  std::optional<MachineRun> machine_run_;
  std::optional<MotionTimer> timer_;  // of the last tool
  bool any_deviation_ = false;
  bool finishing_ = false;  // the finish tool has begun to cut
  MotionStore motions_;
  std::vector<std::size_t> first_motion_;  // of each program
  std::map<std::uint16_t, std::unique_ptr<PathProof>> proofs_;
  std::optional<StoneClearance> stones_;
  std::map<std::uint16_t, CutterProof> other_proofs_;  // of cutters that are no balls
  double proven_other_mm_ = 0.0;                       // by the cells that they leave
  std::size_t anything_cut_ = 0;
  Certificate c_;
};

Result<void> Verifying::check() const {
  if (!std::isfinite(top_mm_))
    return fail(kCellOutOfRange, fmt::format("stock_top is {} mm, expected a height", top_mm_));
  return {};
}

Result<std::uint16_t> Verifying::cutter_of(const Motion& motion, std::size_t program) const {
  if (options_.tools.empty()) return std::uint16_t{0};
  const int number = motion.tool;
  for (std::size_t i = 0; i < options_.tools.size(); ++i)
    if (options_.tools[i].number == number || (number == 0 && i == 0))
      return static_cast<std::uint16_t>(i);
  return fail(kToolNotInTable,
              fmt::format("{}:{}: cuts with tool {}, which is not in the tool table of {} tools",
                          programs_[program].string(), motion.line, number, options_.tools.size()));
}

/// From here on the time is that tool's in that program.
void Verifying::use(std::size_t program, int tool) {
  if (!c_.tools.empty() && c_.tools.back().program == program && c_.tools.back().number == tool)
    return;
  stop_timer();
  c_.tools.push_back({program, tool, {}});
  if (options_.machine) timer_.emplace(*options_.machine, PathControl{});
}

void Verifying::stop_timer() {
  if (!timer_) return;
  timer_->rest();
  c_.tools.back().time += timer_->time();
  timer_.reset();
}

void Verifying::sum_up_times() {
  stop_timer();
  // A tool that comes back is one line of the table.
  std::vector<ToolUse> uses;
  for (const ToolUse& one : c_.tools) {
    c_.time_min += one.time.total_s() / 60.0;
    const auto same = std::find_if(uses.begin(), uses.end(), [&](const ToolUse& u) {
      return u.program == one.program && u.number == one.number;
    });
    if (same == uses.end())
      uses.push_back(one);
    else
      same->time += one.time;
  }
  std::erase_if(uses, [](const ToolUse& use) { return use.time.cutting_mm == 0.0; });
  c_.tools = std::move(uses);
}

Result<void> Verifying::take(std::span<const Motion> motions, std::size_t program) {
  std::size_t begin = 0;
  while (begin < motions.size()) {
    MAQUETTE_TRY(const std::uint16_t cutter, cutter_of(motions[begin], program));
    use(program, motions[begin].tool);
    std::size_t end = begin;
    for (; end < motions.size() && motions[end].tool == motions[begin].tool; ++end) {
      const Motion& m = motions[end];
      const bool rapid = m.kind == Motion::Kind::rapid;
      const double length = length_mm(m);
      (rapid ? c_.rapid_length_mm : c_.cutting_length_mm) += length;
      // What an operation before the finish does within its allowance comes on top of nothing.
      finishing_ = finishing_ || (!rapid && m.tool == options_.finish_tool);
      if (!rapid && m.control && finishing_)
        c_.blending_mm = std::fmax(c_.blending_mm.value_or(0.0), blending_mm(*m.control));
      if (timer_) {
        timer_->add(m);
      } else if (!rapid) {
        c_.tools.back().time.cutting_mm += length;
        c_.tools.back().time.cutting_s += 60.0 * length / m.feed_mm_min;
      } else {
        c_.tools.back().time.rapid_mm += length;
      }
      c_.travel.add(m.from_mm);
      if (m.kind == Motion::Kind::arc)
        for_each_piece(m, [&](const PathPiece& p) {
          c_.travel.add(p.to_mm);
          any_deviation_ = any_deviation_ || p.deviation_mm > 0.0;
        });
      c_.travel.add(m.to_mm);
      motions_.add(m, cutter);
    }
    const auto some = motions.subspan(begin, end - begin);
    used_[cutter] = true;
    last_cutter_ = cutter;
    if (options_.finish_tool == 0 || options_.finish_tool == motions[begin].tool)
      c_.ball_diameter_mm = 2.0 * cutters_[cutter].radius_mm;
    if (!cutters_[cutter].is_ball()) {
      other_proofs_.try_emplace(cutter, design_, cutters_[cutter], options_.gouge_limit.value())
          .first->second.add(some);
    } else {
      const BallNose ball{cutters_[cutter].radius_mm};
      auto& proof = proofs_[cutter];
      if (!proof)
        proof = std::make_unique<PathProof>(
            design_, ball, PathProofOptions{.limit_mm = options_.gouge_limit.value()});
      proof->add(some, program);
    }
    if (stones_) stones_->add(some, cutter, program);
    begin = end;
  }
  return {};
}

Result<void> Verifying::read() {
  std::uintmax_t all_bytes = 0;
  for (const auto& program : programs_) {
    std::error_code ec;
    const std::uintmax_t bytes = std::filesystem::file_size(program, ec);
    if (!ec) all_bytes += bytes;
  }
  double bytes_done = 0.0;
  for (std::size_t i = 0; i < programs_.size(); ++i) {
    first_motion_.push_back(motions_.size());
    std::vector<Motion> made;
    const MotionSink sink = [&](std::span<const Motion> motions) -> Result<void> {
      if (machine_run_) {
        made.clear();
        for (const Motion& m : motions) machine_run_->add(m, made);
        motions = made;
      }
      MAQUETTE_TRY_VOID(take(motions, i));
      // About 20 bytes a block: only for the progress bar.
      const double lines = static_cast<double>(motions_.size() - first_motion_.back());
      if (all_bytes > 0)
        run_.progress(kReadingShare *
                      std::fmin(1.0, (bytes_done + 20.0 * lines) / static_cast<double>(all_bytes)));
      if (run_.stopped()) return fail(kCancelled, "verifying was stopped");
      return {};
    };
    const std::string name = programs_[i].string();
    MAQUETTE_TRY(const ProgramSummary summary, read_gcode(programs_[i], sink, run_));
    bytes_done += static_cast<double>(summary.bytes);
    c_.blocks += summary.blocks;
    c_.moves += summary.motions;
    c_.time_min += summary.dwell_s / 60.0;
    if (!summary.ended) run_.warn(fmt::format("{}: ends without M2, M30 or '%'", name));
    if (summary.tool_changes > 1 && options_.tools.empty())
      run_.warn(fmt::format("{}: changes the tool {} times; all is cut with one ball of {} mm",
                            name, summary.tool_changes, c_.ball_diameter_mm));
    if (summary.skipped_blocks > 0)
      run_.warn(fmt::format("{}: {} blocks begin with '/' and were skipped", name,
                            summary.skipped_blocks));
  }
  return {};
}

Result<void> Verifying::prove_paths() {
  for (auto& [cutter, proof] : proofs_) {
    PathCertificate one = proof->finish();
    proof.reset();
    if (!c_.path) {
      c_.path = std::move(one);
      continue;
    }
    PathCertificate& all = *c_.path;
    all.max_gouge_mm = std::fmax(all.max_gouge_mm, one.max_gouge_mm);
    all.proven_mm = std::fmax(all.proven_mm, one.proven_mm);
    all.motions += one.motions;
    all.drops += one.drops;
    all.gouging_motions += one.gouging_motions;
    all.undecided += one.undecided;
    all.places.insert(all.places.end(), one.places.begin(), one.places.end());
    std::stable_sort(
        all.places.begin(), all.places.end(),
        [](const PathGouge& a, const PathGouge& b) { return a.depth_mm > b.depth_mm; });
  }
  if (stones_) {
    StoneMeetings met = stones_->finish();
    c_.stone_collisions = met.cutters;
    c_.stone_holder_collisions = met.holders;
    c_.first_stone_collisions = std::move(met.first_cutters);
    c_.first_stone_holder_collisions = std::move(met.first_holders);
    stones_.reset();
  }
  proofs_.clear();
  if (run_.stopped()) return fail(kCancelled, "verifying was stopped");
  return {};
}

CutterError Verifying::error() const {
  const heightmap::HeightRange range = heightmap::height_range(design_.z_mm);
  double largest =
      std::fmax(std::abs(highest_stock_mm_), std::fmax(std::abs(static_cast<double>(range.min)),
                                                       std::abs(static_cast<double>(range.max))));
  if (!c_.travel.empty()) largest = std::fmax(largest, std::abs(c_.travel.min.z));
  CutterError worst;
  for (const Cutter& cutter : cutters_) {
    const MillingSim::Precision p = MillingSim::precision(largest, cutter.radius_mm, plan_.cell_mm);
    worst.sideways_mm = std::fmax(worst.sideways_mm, p.horizontal_mm);
    worst.vertical_mm = std::fmax(worst.vertical_mm, p.vertical_mm);
  }
  if (any_deviation_) worst.sideways_mm += kPieceDeviation_mm;
  worst.vertical_mm += kSolvedHeight_mm;
  return worst;
}

ComparisonOptions Verifying::comparison_options() const {
  ComparisonOptions o;
  o.per_spacing = plan_.per_spacing;
  o.cell_mm = plan_.cell_mm;
  o.error = error();
  o.stepover_mm = options_.stepover.value();
  o.deepest_gouge_mm = c_.path ? c_.path->proven_mm : 0.0;
  o.reach_radius_mm = INFINITY;
  for (std::size_t i = 0; i < cutters_.size(); ++i) {
    if (!used_[i]) continue;
    const int number = options_.tools.empty() ? 0 : options_.tools[i].number;
    // A roughing cutter with a small corner reaches where the finish does not.
    if (options_.finish_tool == 0 ? i == last_cutter_ : options_.finish_tool == number) {
      o.reach_radius_mm = std::fmin(o.reach_radius_mm, cutters_[i].corner_radius_mm);
      o.border_mm = std::fmax(o.border_mm, cutters_[i].radius_mm);
    }
    // What other cutters leave before is looked at when they are done.
    if (cutters_[i].is_ball() || i == last_cutter_) o.cutters.push_back(cutters_[i]);
  }
  if (std::isinf(o.reach_radius_mm)) o.reach_radius_mm = 0.0;  // no motion at all
  return o;
}

Result<void> Verifying::cut_band(Comparison& comparison, std::ptrdiff_t b0, std::ptrdiff_t b1,
                                 MoveEffects& effects, const RowSink& rows) {
  const std::ptrdiff_t n = comparison.block_nodes();
  const bool northernmost = b1 == comparison.block_rows();
  // Windows begin at whole blocks of eight.
  const std::ptrdiff_t first = std::max<std::ptrdiff_t>(0, b0 * n - Comparison::kMargin) / 8 * 8;
  const std::ptrdiff_t end = std::min(plan_.rows, b1 * n + Comparison::kMargin + 1);
  SimGrid grid{design_.x0.value(), design_.y0.value(), plan_.cell_mm, first, 0};
  grid.counted_from_row = b0 * n / 8 * 8;
  if (!northernmost) grid.counted_to_row = b1 * n / 8 * 8;
  MillingSim sim(grid, cutters_,
                 block_heights({Millimetres{top_mm_}, options_.stock}, design_.x0, design_.y0,
                               Millimetres{plan_.cell_mm}, first, end, plan_.cols));
  const double y_min = design_.y0.value() + plan_.cell_mm * static_cast<double>(first);
  const double y_max = design_.y0.value() + plan_.cell_mm * static_cast<double>(end);
  double reach = 0.0;
  for (const Cutter& cutter : cutters_) reach = std::fmax(reach, widest_mm(cutter));

  std::vector<ToolMove> moves;
  moves.reserve(kMovesPerCut + 64);
  std::uint16_t cutter = last_cutter_;
  bool stopped = false;
  const auto flush = [&] {
    sim.cut(moves, effects);
    moves.clear();
    stopped = stopped || run_.stopped();
  };
  // A cutter that is no ball is proven by what it leaves, before another one cuts.
  const auto end_stage = [&] {
    flush();
    if (cutters_[cutter].is_ball()) return;
    proven_other_mm_ =
        std::fmax(proven_other_mm_,
                  comparison.proven_gouge_mm({sim.stock_mm(), first}, b0, b1, cutters_[cutter]));
  };
  bool any = false;
  motions_.for_each(y_min, y_max, reach + 1.0, [&](const MotionStore::Stored& stored) {
    if (stopped) return;
    if (any && stored.cutter != cutter) end_stage();
    any = true;
    cutter = stored.cutter;
    append_tool_moves(stored.motion, cutters_[cutter], stored.cutter, stored.index, moves);
    if (moves.size() >= kMovesPerCut) flush();
  });
  if (any) end_stage();
  if (stopped) return fail(kCancelled, "verifying was stopped");

  const MilledBand band{sim.stock_mm(), first};
  MAQUETTE_TRY_VOID(comparison.add(band, b0, b1, run_));
  const MilledShape shape{plan_.rows, plan_.cols, Millimetres{plan_.cell_mm}, design_.x0,
                          design_.y0};
  for (std::ptrdiff_t r = northernmost ? plan_.rows - 1 : b1 * n - 1; r >= b0 * n; --r)
    MAQUETTE_TRY_VOID(rows(shape, r, sim.stock_mm().row(r - first)));
  return {};
}

Result<void> Verifying::cut(const RowSink& rows) {
  Comparison comparison(design_, comparison_options());
  MoveEffects effects(motions_.size());
  const std::ptrdiff_t blocks = comparison.block_rows();
  const std::ptrdiff_t at_once = std::max<std::ptrdiff_t>(1, kBandNodes / comparison.block_nodes());
  for (std::ptrdiff_t end = blocks; end > 0;) {  // files are north up
    const std::ptrdiff_t begin = std::max<std::ptrdiff_t>(0, end - at_once);
    MAQUETTE_TRY_VOID(cut_band(comparison, begin, end, effects, rows));
    end = begin;
    run_.progress(kReadingShare + (0.99 - kReadingShare) * static_cast<double>(blocks - begin) /
                                      static_cast<double>(blocks));
  }
  comparison.finish(c_);
  sum_up(effects);
  return {};
}

void Verifying::sum_up(const MoveEffects& effects) {
  const double cell = plan_.cell_mm, per_unit = MoveEffects::kUnit_mm * cell * cell;
  std::size_t program = 0;
  motions_.for_each(-INFINITY, INFINITY, 0.0, [&](const MotionStore::Stored& stored) {
    Motion m = stored.motion;
    if (!options_.tools.empty()) m.tool = options_.tools[stored.cutter].number;
    const std::size_t i = stored.index;
    while (program + 1 < first_motion_.size() && first_motion_[program + 1] <= i) ++program;
    const double volume = per_unit * static_cast<double>(effects.removed[i]);
    anything_cut_ += effects.removed[i] > 0;
    if (m.kind == Motion::Kind::rapid)
      c_.engagement.removed_mm3 += volume;
    else
      c_.engagement.add(length_mm(m), volume, m.feed_mm_min, cell);
    if (options_.visit) options_.visit(m, program, volume);
    const auto note = [&](std::uint8_t bit, std::uint64_t& count, std::vector<MotionPlace>& list) {
      if ((effects.touched[i] & bit) == 0) return;
      ++count;
      if (list.size() < kCollisionsListed) list.push_back({program, m.line, m.to_mm});
    };
    note(MoveEffects::kRapid, c_.rapid_collisions, c_.first_rapid_collisions);
    note(MoveEffects::kHolder, c_.holder_collisions, c_.first_holder_collisions);
  });
}

void Verifying::prove_gouge() {
  const double by_cells = std::fmax(c_.cell_gouge_mm + c_.cell_bound_mm, proven_other_mm_);
  double found = c_.cell_gouge_mm, by_path = 0.0;
  for (const auto& [cutter, proof] : other_proofs_) by_path = std::fmax(by_path, proof.proven_mm());
  by_path = std::fmin(by_path, proven_other_mm_);
  if (c_.path) {
    found = std::fmax(found, c_.path->max_gouge_mm);
    by_path = std::fmax(by_path, c_.path->proven_mm);
  }
  const double proven = std::fmin(by_cells, by_path);
  c_.max_gouge_mm = found;
  c_.bound_mm = std::fmax(0.0, proven - found);
}

Result<Certificate> Verifying::finish() {
  if (anything_cut_ == 0) {
    const std::string where =
        c_.travel.empty()
            ? "there are no moves at all"
            : fmt::format("the tip goes from ({:.3f}, {:.3f}, {:.3f}) to ({:.3f}, {:.3f}, {:.3f})",
                          c_.travel.min.x, c_.travel.min.y, c_.travel.min.z, c_.travel.max.x,
                          c_.travel.max.y, c_.travel.max.z);
    return fail(kGcodeNoCut,
                fmt::format("{}: nothing is cut: {} mm, expected it to enter the stock, x {:.3f} "
                            "to {:.3f}, y {:.3f} to {:.3f}, top {:.3f} mm; do program and design "
                            "share one frame?",
                            programs_.empty() ? std::string("no program") : programs_[0].string(),
                            where, design_.x_mm(0), design_.x_mm(design_.z_mm.cols() - 1),
                            design_.y_mm(0), design_.y_mm(design_.z_mm.rows() - 1), top_mm_));
  }
  prove_gouge();
  const Vec3 span = c_.travel.max - c_.travel.min;
  const auto check = [&](const char* axis, double length, double travel) {
    if (length > travel + kTick_mm) c_.beyond_travel += axis;
  };
  if (options_.machine) {
    check("x", span.x, options_.machine->travel_mm.x);
    check("y", span.y, options_.machine->travel_mm.y);
    check("z", span.z, options_.machine->travel_mm.z);
  }
  if (machine_run_) c_.displaced_mm = machine_run_->largest_mm();
  MAQUETTE_TRY(c_.program_sha256, fingerprint(programs_));
  run_.progress(1.0);
  return std::move(c_);
}

}  // namespace

Result<Certificate> verify(std::span<const std::filesystem::path> programs,
                           const heightmap::ModelField& design, const VerifyOptions& options,
                           const RowSink& rows, const RunContext& run) {
  MAQUETTE_TRY(const GridPlan plan, plan_grid(design, options));
  Verifying work(programs, design, options, plan, run);
  MAQUETTE_TRY_VOID(work.check());
  MAQUETTE_TRY_VOID(work.read());
  work.sum_up_times();
  MAQUETTE_TRY_VOID(work.prove_paths());
  MAQUETTE_TRY_VOID(work.cut(rows));
  return work.finish();
}

Result<Verification> verify(std::span<const std::filesystem::path> programs,
                            const heightmap::ModelField& design, const VerifyOptions& options,
                            const RunContext& run) {
  Verification result;
  heightmap::ModelField& field = result.as_milled;
  const RowSink keep = [&](const MilledShape& shape, std::ptrdiff_t row,
                           std::span<const float> heights) -> Result<void> {
    if (field.z_mm.empty())
      field = {Grid<float>(shape.rows, shape.cols), shape.cell, shape.x0, shape.y0};
    std::copy(heights.begin(), heights.end(), field.z_mm.row(row).begin());
    return {};
  };
  MAQUETTE_TRY(result.certificate, verify(programs, design, options, keep, run));
  return result;
}

}  // namespace maquette::cnc
