// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file photographs.hpp
/// What photographs of the part show that the simulated picture lacks, and why.
///
/// Room    diagnosis:  case -> [diagnose_photographs] -> report
/// Takes   photographs with poses, lamp and reflectance as declared; the surface they show
/// Gives   a Diagnosis in 1/255 of full scale
///
/// Method
/// - Forward model: photo_chain.hpp; four rays a pixel, shadows traced. Whether slopes are those of
///   facets or smooth between nodes is what fits better.
/// - A model is fitted by Gauss and Newton, rendered anew in each round, Huber's loss. Noise is as
///   declared times a factor that the data give, and what a displacement of a tenth of a pixel
///   would change.
/// - Values of neighbouring pixels err alike (the surface is not quite as simulated). What a sum
///   over pixels is worth less for that is read off the sums over cells and their neighbours
///   (Conley, J. Econometrics 92 (1999), doi:10.1016/S0304-4076(98)00084-0) of what all causes
///   together leave.
/// - Choosing: forward on one third of the blocks of the surface, the closest candidates rendered
///   anew; backward; other forms and other causes in each one's place. Confirming on the second
///   third, at the level of the scans' diagnosis. Gain on the last.
/// - photo.noise: scatter of differences between neighbouring pixels, against level.

#include <cstdint>
#include <vector>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "diagnosis/case_input.hpp"
#include "diagnosis/diagnose.hpp"
#include "diagnosis/photo_chain.hpp"

namespace maquette::diagnosis {

inline constexpr ErrorCode kPhotograph{"DIAGNOSIS_PHOTO"};

/// @param part  design, ground and programs, as for scans; pixels of stones have no say
/// @param with_controls  the same on pictures simulated from what was found: with it in the model
///   (nothing may be named), and without (it must come back); twice the time
/// @return DIAGNOSIS_PHOTO: a picture that is not as stated, or shows too little of the surface;
///   errors of the readers; CORE_CANCELLED
[[nodiscard]] Result<Diagnosis> diagnose_photographs(const CaseInput& part,
                                                     const std::vector<PhotoInput>& photos,
                                                     bool with_controls,
                                                     const RunContext& run = {});

}  // namespace maquette::diagnosis
