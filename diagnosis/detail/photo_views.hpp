// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

// Photographs of a case beside what the chain makes of them.

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "core/grid.hpp"
#include "core/result.hpp"
#include "core/run_context.hpp"
#include "diagnosis/photo_chain.hpp"
#include "heightmap/field_tracer.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::diagnosis::detail {

/// A photograph as measured: linear values by channel, 1 or 3.
struct Photograph {
  std::vector<Grid<float>> value;  ///< row 0 is the upper; NaN where it says nothing
  double quantum = 0.0;            ///< step of 8-bit numbers, sRGB; 0: none that matters
};
/// @return errors of the reader; DIAGNOSIS_PHOTO: size or channels are others than stated
[[nodiscard]] Result<Photograph> read_photograph(const PhotoInput& photo);

/// Slope of the surface between its nodes: of the two triangles of a cell, of a bilinear patch, or
/// linear between slopes at the nodes: central differences, or of fourth order.
enum class Normals { facets, patches, smooth, smoother };

/// A pixel with what was measured there.
struct MeasuredPixel : PhotoPixel {
  std::array<float, 3> measured{}, variance{};  ///< variance as declared, of the measured value
  /// Of what was measured around, as were all of it light and the numbers linear: models are
  /// compared by that, and one shall not seem better for the noise it would have.
  std::array<float, 3> variance_around{};
  std::array<float, 3> cut_sigma{};   ///< of its noise, where the file cuts it off at 0
  std::array<float, 3> next{};        ///< measured at the next pixel of the row
  std::array<float, 3> value_next{};  ///< behind the lens there, as rendered
  std::uint32_t at = 0;               ///< row times width plus column
  double of_rays = 0.0;               ///< mean radiance of its rays
};

/// Red, green, blue: a picture in grey is green's.
[[nodiscard]] constexpr int channel_of(std::size_t channel, std::size_t channels) {
  return channels == 1 ? 1 : static_cast<int>(channel);
}

class PhotoViews {
 public:
  /// `surfaces` by photograph; keeps references.
  /// @param left_out  by photograph: pixels that are not compared; empty: all are
  /// @param held_out  shows those that are held out, else the others
  PhotoViews(const PhotoScene& scene, std::vector<Photograph> photographs,
             std::vector<const heightmap::ModelField*> surfaces,
             std::vector<Grid<std::uint8_t>> left_out = {}, bool held_out = false);

  /// Renders all photographs in a state. @post pixels() and scene().lamp_sizes_mm are of it
  /// @param derivatives  false: where only light and sensor differ from what was rendered last,
  ///   and places move by a fifth of a pixel at most,
  ///   pixels alone are, their derivatives and what they see of lamps of other sizes stay
  /// @param lamp_sizes  with what pixels see of lamps of other sizes
  void render(const PhotoState& state, Normals normals, bool derivatives = true,
              bool lamp_sizes = true);
  /// Renders from now on only those pixels of the lattice whose places, as rendered last, are of
  /// that kind, and what is around them; empty: all. pixels() are these alone, derivatives and the
  /// veil's mean are of them.
  /// @pre rendered
  void look_at(const std::function<bool(const Vec3& place)>& kind);
  /// Puts what a state gives, with noise as declared times a factor, in the place of what was
  /// measured at the pixels. @post rendered in that state
  void simulate(const PhotoState& state, Normals normals, double noise_factor, std::uint64_t seed);
  /// Robust spread of differences between neighbouring pixels, measured less rendered: of noise,
  /// and of what the surface between its nodes is taken for.
  [[nodiscard]] double roughness() const;
  /// Widest penumbra that the relief can have under a lamp of that diameter on level ground, in
  /// any picture; in the k-th.
  [[nodiscard]] double penumbra_px(double diameter_mm) const;
  [[nodiscard]] double penumbra_px(double diameter_mm, std::size_t k) const;
  /// Pixels on the surface, on a lattice over each picture; not at its rim, not saturated.
  [[nodiscard]] const std::vector<MeasuredPixel>& pixels() const { return pixels_; }
  /// Rows and columns from one pixel of the lattice to the next.
  [[nodiscard]] std::ptrdiff_t lattice_step(std::size_t photo) const { return views_[photo].step; }
  [[nodiscard]] const PhotoScene& scene() const { return scene_; }
  [[nodiscard]] const PhotoState& state() const { return state_; }
  [[nodiscard]] std::size_t channels() const { return scene_.colour ? 3 : 1; }
  /// What the sensor makes of light behind the lens at a pixel, in the rendered state, on average.
  [[nodiscard]] double number_of(const MeasuredPixel& pixel, std::size_t channel,
                                 float behind_lens) const;

 private:
  static constexpr std::ptrdiff_t kAcross = 2;  ///< rays of a pixel along each side
  struct Sample {
    float x = NAN, y = 0.0F, z = 0.0F;  ///< NaN: beside the surface
    SeenLamp lamp;
  };
  struct View {
    Grid<Sample> samples;     ///< kAcross x kAcross a pixel
    std::ptrdiff_t step = 1;  ///< of the lattice
    std::vector<std::uint32_t> lattice;
    /// Of the first lattice, wholly beside the surface or left out: light as measured.
    std::vector<std::uint32_t> beside{};
    double part_share = 1.0;  ///< of the picture, that the surface fills otherwise
    /// Means over the surface's pixels of their light times the radius^0, 2, 4, as pictured.
    std::array<float, 3> light_of_part{};
    std::vector<std::array<SeenLamp, kLampSizes>>
        lamp_of_size{};  ///< by pixel of the lattice; empty: not known
    std::ptrdiff_t traced_reach = 0;
    std::vector<std::uint8_t> looked_at{};  ///< by pixel of the lattice; empty: all are
    Grid<std::uint8_t> near{};  ///< squares of a step that hold these or what is around them
    /// Is the pixel near enough to one of the lattice to matter?
    [[nodiscard]] bool wanted(std::ptrdiff_t row, std::ptrdiff_t col, std::ptrdiff_t reach) const {
      if (!looked_at.empty() && near(row / step, col / step) == 0) return false;
      const auto off = [&](std::ptrdiff_t i) {
        const std::ptrdiff_t at = (i - step / 2) % step;
        return at < 0 ? at + step : at;
      };
      return (off(row) <= reach || step - off(row) <= reach) &&
             (off(col) <= reach + 1 || step - off(col) <= reach);
    }
  };

  [[nodiscard]] double before_cut(const MeasuredPixel& pixel, std::size_t channel,
                                  float behind_lens) const;
  void take_slopes();
  [[nodiscard]] bool look_into_the_dark();
  void take_surroundings(std::size_t photo);
  void find_near(std::size_t photo);
  void trace(std::size_t photo);
  void see_lamp(std::size_t photo);
  void light_pixels();
  [[nodiscard]] bool hardly_moves(const PhotoState& state) const;
  void shift_pixels();
  struct RayLight {
    double light = 0.0;
    SeenLamp lamp;
  };
  [[nodiscard]] RayLight light_of(std::size_t photo, std::uint32_t at, bool moved,
                                  const PhotoChain& chain) const;
  void look_around();
  void look_around_from(std::size_t photo, PhotoPixel& pixel) const;
  void show(std::size_t photo, const Sample& ray, PhotoPixel& pixel) const;
  [[nodiscard]] std::vector<double> light_by_photo() const;
  [[nodiscard]] std::ptrdiff_t reach() const;
  [[nodiscard]] Vec3 normal_at(std::size_t photo, double x, double y) const;
  [[nodiscard]] Grid<float> picture(std::size_t photo, Grid<float>& hits) const;
  void select(std::size_t photo, const Grid<float>& hits);
  [[nodiscard]] double mean_light(std::size_t photo, std::size_t channel, double change) const;
  void take_pixels(std::size_t photo, bool lamp_sizes, std::vector<MeasuredPixel>& out);
  [[nodiscard]] std::array<SeenLamp, kLampSizes> lamp_of_sizes(std::size_t photo,
                                                               std::uint32_t at) const;

  [[nodiscard]] bool is_left_out(std::size_t photo, std::uint32_t at) const {
    return !left_out_.empty() && left_out_[photo].cells()[at] != 0;
  }
  [[nodiscard]] bool shows(std::size_t photo) const {
    return scene_.photos[photo].held_out == held_out_;
  }

  PhotoScene scene_;
  std::vector<Grid<std::uint8_t>> left_out_;
  bool held_out_;
  std::vector<Photograph> photographs_;
  /// Of noise in full shadow, by photograph and channel.
  struct Dark {
    float sigma = 0.0F;  ///< 0: not known, or as declared
    bool cut = false;    ///< numbers below 0 are missing
  };
  std::vector<std::array<Dark, 3>> dark_;
  /// By photograph, channel and width: what was measured, levelled, every kEach pixels.
  std::vector<std::array<std::array<Grid<float>, kHaloWidths.size()>, 3>> around_;
  std::vector<const heightmap::ModelField*> surfaces_;
  std::vector<std::size_t> tracer_of_;
  std::vector<heightmap::FieldTracer> tracers_;
  struct Slopes {
    Grid<float> x, y;  ///< at nodes
  };
  std::vector<Slopes> slopes_;  ///< by tracer
  std::optional<Normals> slopes_of_;
  Grid<float> sky_;
  std::array<Grid<float>, 3> sky_side_;
  std::vector<Grid<float>> bounce_, bounce_all_;  ///< by lamp
  double around_step_mm_ = 1.0;
  std::vector<View> views_;
  std::vector<MeasuredPixel> pixels_;
  PhotoState state_;     ///< of pixels_
  PhotoState traced_;    ///< of the rays' places and what they see of the lamp
  PhotoState pictured_;  ///< of the last whole pictures
  std::vector<MeasuredPixel> pictured_pixels_;
  std::vector<double> light_before_;  ///< by photograph: its pixels'
  Normals normals_ = Normals::smooth;
  bool rendered_ = false, selected_ = false, looks_anew_ = false;
};

}  // namespace maquette::diagnosis::detail
