// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/photo_forms.hpp"

namespace maquette::diagnosis::detail {
namespace {
/// Less bends full scale by a thousandth: no sensor is stated to be as linear (EMVA 1288: 1 %).
constexpr double kLeastExponent = 0.003;
}  // namespace

void add_photo_gamma(std::vector<Effect>& all) {
  Effect e;
  e.name = "photo.gamma";
  e.says = "values are a power of the light";
  e.source = "tone curve left in the file: IEC 61966-2-1 and its kin";
  e.acts_on = "sensor";
  e.depends_on = "level";
  e.looks_like = {"photo.exposure", "photo.black_level"};
  e.separate_by = "pictures at several exposures";
  e.correction = "develop the raw file without a tone curve";
  e.needs = Needs::photograph;
  e.photo_forms = [](const PhotoScene&) -> std::vector<PhotoForm> {
    PhotoForm form{"exponent", {number("gamma", "exponent_less_1", 0.01, &PhotoState::gamma)}};
    form.least = kLeastExponent;
    return {std::move(form)};
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail
