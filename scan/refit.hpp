// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file refit.hpp
/// Best fits once more, without what was found to differ.
///
/// Room     scan:  significance -> [refit] -> deviate, significance
/// Takes    points of several scans in the model frame, their poses, patches that were found
/// Gives    the same points and poses after fits that these patches have no part in
///
/// Why      A patch that is lower than the noise of one point pulls a best fit along the slopes
///          that it lies on: robust weights of points do not see it. A band of a tenth of a part
///          moved poses by 20 to 50 of their stated standard deviations; it then reads too low, and
///          what is as planned seems to differ.
/// Method   First a robust step on means over cells (some 48 a side), Tukey's biweight, where a
///          patch stands out of the noise: what most of the part agrees on. Patches are sought
///          from there, and points in them (CellMap::in_patch, with the cells beside them) are
///          left out of a registration by place, not by value: the rest is what would have been
///          measured of it without them. Its covariance says what is lost with them. As what is
///          found depends on the pose, both are repeated until the pose rests.
/// Accuracy Chi-square of poses and normalised errors of heights as stated (tests/scan/refit_test).

#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "scan/significance.hpp"

namespace maquette::scan {

/// What stands out where the points lie now, in deviations from the surface that was expected.
using Search = std::function<Result<Significance>()>;

/// @param points_mm  model frame; those of a scan that is fitted again follow it
/// @param scans      of the points in their order; poses and covariances follow
/// @param stations   of each scan, model frame; nothing: not known, or several
/// @param found      where the points lie now
/// @param search     called whenever they have moved
/// @return for each scan the step that its points were moved by: identity where no patch has a part
///   in it, where more than half of its points lie in patches, or where the rest does not tell its
///   pose. CORE_CANCELLED, or what `search` returns
[[nodiscard]] Result<std::vector<RigidTransform>> refit(
    std::span<Vec3> points_mm, std::span<ScanPose> scans,
    std::span<const std::optional<Vec3>> stations, const heightmap::ModelField& surface,
    const Significance& found, const Search& search, const RunContext& run = {});

/// Best fits once more with all points, which have been corrected since: what a beam's width does
/// to ranges (beam_shift.hpp) has no mean of zero, and goes into the pose of a fit made before.
/// @return the step of each scan; identity where the corrected points do not tell its pose.
///   CORE_CANCELLED
[[nodiscard]] Result<std::vector<RigidTransform>> refit_corrected(
    std::span<Vec3> points_mm, std::span<ScanPose> scans,
    std::span<const std::optional<Vec3>> stations, const heightmap::ModelField& surface,
    const RunContext& run = {});

}  // namespace maquette::scan
