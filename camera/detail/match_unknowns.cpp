// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/detail/match_unknowns.hpp"

#include <cmath>

#include <fmt/format.h>

namespace maquette::camera::detail {
namespace {

constexpr double kMilli = 1e3;  // mrad
constexpr std::array kPoseNames{"right_mm",         "up_mm",         "back_mm",
                                "about_right_mrad", "about_up_mrad", "about_back_mrad"};

Quaternion turned_by(Vec3 rad) {
  const double angle = norm(rad);
  return angle > 0.0 ? rotation_about((1.0 / angle) * rad, angle) : Quaternion{};
}
Vec3 turn_of(Quaternion q) {
  if (q.w < 0.0) q = {-q.w, -q.x, -q.y, -q.z};
  const Vec3 v{q.x, q.y, q.z};
  const double s = norm(v);
  return s > 0.0 ? 2.0 * std::atan2(s, q.w) / s * v : Vec3{};
}

double coordinate(Vec3 v, Eigen::Index i) {
  return i == 0 ? v.x : (i == 1 ? v.y : v.z);
}

}  // namespace

Unknowns::Unknowns(const MatchSearch& search, std::size_t photos) : search_(search) {
  const auto take = [&](bool wanted) { return wanted ? count_++ : Eigen::Index{-1}; };
  std::array<Eigen::Index, kOwn> all{};
  all[kExposure] = take(search.exposure && !search.exposure_each);
  for (const Own k : {kRed, kBlue}) all[k] = take(search.white_balance);
  for (std::size_t k = 0; k < 3; ++k) all[kLamp + k] = take(search.lamp_position);
  all[kBrightness] = take(search.lamp_brightness);
  for (std::size_t p = 0; p < photos; ++p) {
    auto& own = places_.emplace_back(all);
    if (search.exposure_each) own[kExposure] = count_++;
    for (std::size_t k = 0; k < 6; ++k) own[kPose + k] = take(search.pose);
  }
}

MatchState Unknowns::moved(MatchState state, const Eigen::VectorXd& step) const {
  const auto at = [&](std::size_t photo, Eigen::Index own) {
    const auto i = place(photo, own);
    return i ? step(*i) : 0.0;
  };
  state.white_balance[0] *= std::exp(at(0, kRed));
  state.white_balance[2] *= std::exp(at(0, kBlue));
  if (search_.lamp_position)
    for (Eigen::Index k = 0; k < 3; ++k)
      state.lighting.lamps.front().position_mm +=
          at(0, kLamp + k) * Vec3{k == 0 ? 1.0 : 0.0, k == 1 ? 1.0 : 0.0, k == 2 ? 1.0 : 0.0};
  if (search_.lamp_brightness)
    for (double& c : state.lighting.lamps.front().colour) c *= std::exp(at(0, kBrightness));
  for (std::size_t p = 0; p < places_.size(); ++p) {
    state.exposure_scale[p] *= std::exp(at(p, kExposure));
    if (!search_.pose) continue;
    RigidTransform& pose = state.model_from_camera[p];
    const Vec3 shift{at(p, kPose), at(p, kPose + 1), at(p, kPose + 2)};
    const Vec3 turn{at(p, kPose + 3), at(p, kPose + 4), at(p, kPose + 5)};
    pose = pose * RigidTransform{turned_by(turn), shift};
    pose.rotation = normalized(pose.rotation);
  }
  return state;
}

std::vector<std::string> Unknowns::names(const std::vector<MatchPhoto>& photos) const {
  std::vector<std::string> names(static_cast<std::size_t>(count_));
  const auto put = [&](std::size_t p, Eigen::Index own, const std::string& name) {
    if (const auto i = place(p, own)) names[static_cast<std::size_t>(*i)] = name;
  };
  put(0, kRed, "white_balance.red");
  put(0, kBlue, "white_balance.blue");
  for (Eigen::Index k = 0; k < 3; ++k) put(0, kLamp + k, fmt::format("lamp.{}_mm", "xyz"[k]));
  put(0, kBrightness, "lamp.brightness");
  for (std::size_t p = 0; p < photos.size(); ++p) {
    put(p, kExposure, search_.exposure_each ? photos[p].name + ": exposure" : "exposure");
    for (std::size_t k = 0; k < 6; ++k)
      put(p, kPose + static_cast<Eigen::Index>(k), photos[p].name + ": " + kPoseNames[k]);
  }
  return names;
}

std::vector<MatchedNumber> Unknowns::numbers(const MatchState& start, const MatchState& now,
                                             const std::vector<MatchPhoto>& photos,
                                             Eigen::MatrixXd& covariance) const {
  std::vector<MatchedNumber> numbers(static_cast<std::size_t>(count_));
  const auto all = names(photos);
  Eigen::VectorXd unit = Eigen::VectorXd::Ones(count_);  // of what is named, by the step's
  const auto put = [&](std::size_t p, Eigen::Index own, double from, double to, double scale) {
    const auto i = place(p, own);
    if (!i) return;
    unit(*i) = scale;
    numbers[static_cast<std::size_t>(*i)] = {all[static_cast<std::size_t>(*i)], from, to, 0.0};
  };
  const auto factor = [&](std::size_t p, Eigen::Index own, double from, double to) {
    put(p, own, 1.0, to / from, to / from);
  };
  factor(0, kRed, start.white_balance[0], now.white_balance[0]);
  factor(0, kBlue, start.white_balance[2], now.white_balance[2]);
  if (search_.lamp_position)
    for (Eigen::Index k = 0; k < 3; ++k)
      put(0, kLamp + k, coordinate(start.lighting.lamps.front().position_mm, k),
          coordinate(now.lighting.lamps.front().position_mm, k), 1.0);
  if (search_.lamp_brightness)
    factor(0, kBrightness, start.lighting.lamps.front().colour[1],
           now.lighting.lamps.front().colour[1]);
  for (std::size_t p = 0; p < photos.size(); ++p) {
    factor(p, kExposure, start.exposure_scale[p], now.exposure_scale[p]);
    const RigidTransform way = start.model_from_camera[p].inverse() * now.model_from_camera[p];
    const Vec3 turn = turn_of(way.rotation);
    for (Eigen::Index k = 0; k < 3; ++k) {
      put(p, kPose + k, 0.0, coordinate(way.translation_mm, k), 1.0);
      put(p, kPose + 3 + k, 0.0, kMilli * coordinate(turn, k), kMilli);
    }
  }
  covariance = unit.asDiagonal() * covariance * unit.asDiagonal();
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    numbers[i].sigma = std::sqrt(std::max(0.0, covariance(k, k)));
  }
  return numbers;
}

}  // namespace maquette::camera::detail
