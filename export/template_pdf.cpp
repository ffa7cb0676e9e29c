// SPDX-License-Identifier: GPL-3.0-or-later

// Sheets of paper at 1:1, by Cairo. Inside a page lengths are millimetres, y upwards.

#include <cairo-pdf.h>
#include <cmath>
#include <string>

#include <fmt/format.h>

#include "core/check.hpp"
#include "export/cad.hpp"
#include "export/pdf_file.hpp"
#include "export/placing_template.hpp"

namespace maquette::exporting {
namespace {

constexpr double kThin_mm = 0.1, kLine_mm = 0.25;
constexpr double kLetters_mm = 3.0;
constexpr int kMostSheets = 2000;

using Point = std::array<double, 2>;

/// The sheet on the table: origin at its lower left corner.
class Pen {
 public:
  Pen(cairo_t* cairo, const Sheet& sheet) : cairo_(cairo), sheet_(sheet) {}

  void line(Point a, Point b, double width_mm) {
    cairo_move_to(cairo_, a[0] * kPointsPerMm, up(a[1]));
    cairo_line_to(cairo_, b[0] * kPointsPerMm, up(b[1]));
    stroke(width_mm);
  }
  void ring(const std::vector<Point>& points, double width_mm) {
    cairo_new_path(cairo_);  // letters leave a point behind
    for (const Point& p : points) cairo_line_to(cairo_, p[0] * kPointsPerMm, up(p[1]));
    cairo_close_path(cairo_);
    stroke(width_mm);
  }
  void box(Point lo, Point hi, double width_mm) {
    ring({lo, {hi[0], lo[1]}, hi, {lo[0], hi[1]}}, width_mm);
  }
  void cross(Point at, double arm_mm, double width_mm) {
    line({at[0] - arm_mm, at[1]}, {at[0] + arm_mm, at[1]}, width_mm);
    line({at[0], at[1] - arm_mm}, {at[0], at[1] + arm_mm}, width_mm);
  }
  void text(Point at, double size_mm, const std::string& letters) {
    cairo_select_font_face(cairo_, "sans-serif", CAIRO_FONT_SLANT_NORMAL, CAIRO_FONT_WEIGHT_NORMAL);
    cairo_set_font_size(cairo_, size_mm * kPointsPerMm);
    cairo_move_to(cairo_, at[0] * kPointsPerMm, up(at[1]));
    cairo_show_text(cairo_, letters.c_str());
  }
  void grey(double level) { cairo_set_source_rgb(cairo_, level, level, level); }
  void clip(Point lo, Point hi) {
    cairo_save(cairo_);
    cairo_rectangle(cairo_, lo[0] * kPointsPerMm, up(hi[1]), (hi[0] - lo[0]) * kPointsPerMm,
                    (hi[1] - lo[1]) * kPointsPerMm);
    cairo_clip(cairo_);
  }
  void unclip() { cairo_restore(cairo_); }
  void next_sheet() { cairo_show_page(cairo_); }

 private:
  [[nodiscard]] double up(double y_mm) const { return (sheet_.height_mm - y_mm) * kPointsPerMm; }
  void stroke(double width_mm) {
    cairo_set_line_width(cairo_, width_mm * kPointsPerMm);
    cairo_stroke(cairo_);
  }

  cairo_t* cairo_;
  const Sheet& sheet_;
};

/// Everything that is drawn from the model, once for each sheet that it may be on.
class Drawer {
 public:
  Drawer(const PlacingTemplate& plan, const Sheet& sheet)
      : plan_(plan), sheet_(sheet), grid_(sheets_of(plan, sheet)), labels_(label_places(plan)) {}

  void overview(Pen& pen) const {
    const double width = plan_.max_mm[0] - plan_.min_mm[0];
    const double height = plan_.max_mm[1] - plan_.min_mm[1];
    const double foot = 30.0;
    const double shown_w = grid_.step_x_mm * (grid_.columns - 1) + sheet_.window_width_mm();
    const double shown_h = grid_.step_y_mm * (grid_.rows - 1) + sheet_.window_height_mm();
    const double scale =
        std::min(sheet_.window_width_mm() / shown_w, (sheet_.window_height_mm() - foot) / shown_h);
    const auto at = [&](Point p) -> Point {
      return {sheet_.margin_mm + scale * (p[0] - plan_.min_mm[0]),
              sheet_.margin_mm + scale * (p[1] - plan_.min_mm[1])};
    };
    pen.grey(0.6);
    for (int row = 0; row < grid_.rows; ++row)
      for (int column = 0; column < grid_.columns; ++column) {
        const Point lo = corner(column, row);
        const Point hi{lo[0] + sheet_.window_width_mm(), lo[1] + sheet_.window_height_mm()};
        pen.box(at(lo), at(hi), kThin_mm);
        const Point middle = at({0.5 * (lo[0] + hi[0]), 0.5 * (lo[1] + hi[1])});
        pen.text({middle[0] - 4.0, middle[1]}, kLetters_mm, sheet_name(column, row));
      }
    pen.grey(0.0);
    pen.box(at(plan_.min_mm), at(plan_.max_mm), kLine_mm);
    for (const auto& j : plan_.joints) pen.line(at({j[0], j[1]}), at({j[2], j[3]}), kThin_mm);
    for (const TemplateStone& s : plan_.stones) {
      std::vector<Point> ring;
      for (const Point& p : s.outline_mm) ring.push_back(at(p));
      pen.ring(ring, kThin_mm);
    }
    const double top = sheet_.height_mm - sheet_.margin_mm;
    pen.text({sheet_.margin_mm, top - 5.0}, 5.0, plan_.name + ": where the stones go");
    pen.text(
        {sheet_.margin_mm, top - 11.0}, kLetters_mm,
        fmt::format("{} stones on {:g} x {:g} mm; {} sheets, this overview is 1:{:.3g}.",
                    plan_.stones.size(), width, height, grid_.columns * grid_.rows, 1.0 / scale));
    pen.text({sheet_.margin_mm, top - 16.0}, kLetters_mm,
             "Print at 100 % without fitting to the page; measure the bar on every sheet.");
    pen.text({sheet_.margin_mm, top - 21.0}, kLetters_mm,
             "Lay sheets over each other so that the same crosses meet.");
  }

  void sheet(Pen& pen, int column, int row) const {
    const Point lo = corner(column, row);
    const double m = sheet_.margin_mm;
    const Point window_lo{m, m};
    const Point window_hi{m + sheet_.window_width_mm(), m + sheet_.window_height_mm()};
    frame(pen, window_lo, window_hi);
    pen.grey(0.0);
    pen.text({m + 8.0, window_hi[1] + 4.0}, kLetters_mm,
             fmt::format("{}   sheet {}   x {:g} to {:g}, y {:g} to {:g} mm   1:1", plan_.name,
                         sheet_name(column, row), lo[0], lo[0] + sheet_.window_width_mm(), lo[1],
                         lo[1] + sheet_.window_height_mm()));
    check_bar(pen);
    pen.clip(window_lo, window_hi);
    const auto on_sheet = [&](Point p) -> Point { return {m + p[0] - lo[0], m + p[1] - lo[1]}; };
    const auto near = [&](Point p, double reach) {
      return p[0] + reach > lo[0] && p[0] - reach < lo[0] + sheet_.window_width_mm() &&
             p[1] + reach > lo[1] && p[1] - reach < lo[1] + sheet_.window_height_mm();
    };
    pen.box(on_sheet(plan_.min_mm), on_sheet(plan_.max_mm), kLine_mm);
    for (const auto& j : plan_.joints)
      pen.line(on_sheet({j[0], j[1]}), on_sheet({j[2], j[3]}), kLine_mm);
    crosses([&](Point p) {
      if (near(p, 5.0)) pen.cross(on_sheet(p), 4.0, kThin_mm);
    });
    for (std::size_t i = 0; i < plan_.stones.size(); ++i)
      if (const TemplateStone& s = plan_.stones[i]; near(s.centre_mm, 2.0 * s.radius_mm + 20.0))
        stone(pen, s, labels_[i], on_sheet);
    pen.unclip();
  }

  [[nodiscard]] const SheetGrid& grid() const { return grid_; }

 private:
  [[nodiscard]] Point corner(int column, int row) const {
    return {plan_.min_mm[0] + column * grid_.step_x_mm, plan_.min_mm[1] + row * grid_.step_y_mm};
  }
  static std::string sheet_name(int column, int row) {
    return fmt::format("{}-{}", column + 1, row + 1);
  }
  /// Where two sheets overlap, in the middle of it, twice along each sheet's side.
  template <class Draw>
  void crosses(Draw draw) const {
    for (int row = 0; row < grid_.rows; ++row)
      for (int column = 0; column < grid_.columns; ++column) {
        const Point lo = corner(column, row);
        for (const double share : {0.25, 0.75}) {
          if (column > 0)
            draw({lo[0] + 0.5 * sheet_.overlap_mm, lo[1] + share * sheet_.window_height_mm()});
          if (row > 0)
            draw({lo[0] + share * sheet_.window_width_mm(), lo[1] + 0.5 * sheet_.overlap_mm});
        }
      }
  }
  void frame(Pen& pen, Point lo, Point hi) const {
    pen.grey(0.75);
    pen.box(lo, hi, kThin_mm);
    pen.grey(0.0);
    const double length = std::min(6.0, 0.5 * sheet_.margin_mm);
    for (const double x : {lo[0], hi[0]})
      for (const double y : {lo[1], hi[1]}) {
        const double out_x = x == lo[0] ? -1.0 : 1.0, out_y = y == lo[1] ? -1.0 : 1.0;
        pen.line({x + out_x, y}, {x + out_x * length, y}, kThin_mm);
        pen.line({x, y + out_y}, {x, y + out_y * length}, kThin_mm);
      }
  }
  void check_bar(Pen& pen) const {
    const double length = sheet_.window_width_mm() >= 130.0 ? 100.0 : 50.0;
    const double x = sheet_.margin_mm + 8.0, y = 0.5 * sheet_.margin_mm;
    pen.line({x, y}, {x + length, y}, kLine_mm);
    for (const double end : {x, x + length}) pen.line({end, y - 1.5}, {end, y + 1.5}, kThin_mm);
    pen.text({x + length + 2.0, y - 1.0}, kLetters_mm, fmt::format("{:g} mm", length));
  }
  template <class OnSheet>
  void stone(Pen& pen, const TemplateStone& s, Point label, OnSheet on_sheet) const {
    std::vector<Point> ring;
    for (const Point& p : s.outline_mm) ring.push_back(on_sheet(p));
    pen.ring(ring, kLine_mm);
    pen.cross(on_sheet(s.centre_mm), 1.0, kThin_mm);
    pen.line(on_sheet(s.centre_mm), on_sheet(heading_end(s)), kLine_mm);
    pen.text(on_sheet(label), kLabelLetters_mm, label_of(s));
  }

  const PlacingTemplate& plan_;
  const Sheet& sheet_;
  SheetGrid grid_;
  std::vector<Point> labels_;
};

Result<void> check_sheet(const PlacingTemplate& plan, const Sheet& sheet,
                         const std::filesystem::path& path) {
  const double smallest = std::min(sheet.window_width_mm(), sheet.window_height_mm());
  if (!(smallest >= 70.0) || !(sheet.overlap_mm >= 0.0 && sheet.overlap_mm <= 0.5 * smallest))
    return fail(kOptionOutOfRange,
                fmt::format("{}: sheets of {:g} x {:g} mm with margins of {:g} mm that overlap by "
                            "{:g} mm: a window of 70 mm or more and an overlap of at most half of "
                            "it expected",
                            path.string(), sheet.width_mm, sheet.height_mm, sheet.margin_mm,
                            sheet.overlap_mm));
  const SheetGrid grid = sheets_of(plan, sheet);
  if (grid.columns > kMostSheets || grid.rows > kMostSheets ||
      grid.columns * grid.rows > kMostSheets)
    return fail(kOptionOutOfRange,
                fmt::format("{}: a part of {:g} x {:g} mm takes {} x {} sheets, more than {}; use "
                            "the DXF on a plotter or larger paper",
                            path.string(), plan.max_mm[0] - plan.min_mm[0],
                            plan.max_mm[1] - plan.min_mm[1], grid.columns, grid.rows, kMostSheets));
  return {};
}

}  // namespace

SheetGrid sheets_of(const PlacingTemplate& plan, const Sheet& sheet) {
  SheetGrid grid;
  grid.step_x_mm = sheet.window_width_mm() - sheet.overlap_mm;
  grid.step_y_mm = sheet.window_height_mm() - sheet.overlap_mm;
  const auto count = [&](double size, double step) {
    const double more = std::ceil((size - sheet.overlap_mm) / step - 1e-9);
    return static_cast<int>(std::clamp(more, 1.0, 1e6));
  };
  grid.columns = count(plan.max_mm[0] - plan.min_mm[0], grid.step_x_mm);
  grid.rows = count(plan.max_mm[1] - plan.min_mm[1], grid.step_y_mm);
  return grid;
}

Result<void> write_template_pdf(const PlacingTemplate& plan, const Sheet& sheet,
                                const std::filesystem::path& path) {
  MAQUETTE_CHECK(plan.min_mm[0] < plan.max_mm[0] && plan.min_mm[1] < plan.max_mm[1], "{}",
                 plan.name);
  MAQUETTE_TRY_VOID(check_sheet(plan, sheet, path));
  return write_pdf_file(path, plan.name + ": placing template 1:1", sheet.width_mm * kPointsPerMm,
                        sheet.height_mm * kPointsPerMm, [&](cairo_t* cairo) {
                          Pen pen(cairo, sheet);
                          const Drawer drawer(plan, sheet);
                          drawer.overview(pen);
                          pen.next_sheet();
                          for (int row = 0; row < drawer.grid().rows; ++row)
                            for (int column = 0; column < drawer.grid().columns; ++column) {
                              drawer.sheet(pen, column, row);
                              pen.next_sheet();
                            }
                        });
}

}  // namespace maquette::exporting
