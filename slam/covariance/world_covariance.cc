#include "slam/covariance/world_covariance.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory_resource>
#include <vector>

#include "base/stack_arena.h"
#include "slam/covariance/excess_covariance.h"
#include "slam/covariance/marker_information.h"
#include "slam/geometry/minimize_pose.h"
#include "slam/geometry/turned_covariance.h"
#include "slam/optimization/block_kernels.h"

namespace waymark::slam {
namespace {

// One marker's say in the pose.
struct Voice {
  const KnownMarker* marker = nullptr;
  Matrix6d gain;  // G = T^T A: what its error adds to the right side of the normal equations
  double information = 0.0;
  bool of_map = false;  // its place, and what it has in common with the leader's, is known

  [[nodiscard]] int id() const { return marker->detection->id; }
};

using Voices = std::pmr::vector<Voice*>;  // those that say most first
using Blocks = std::pmr::vector<const Matrix6d*>;

// Marks those whose common covariances are all known, each in its turn: blocks of one positive
// matrix. Returns these blocks, row by row: with those before it, then its own.
Blocks chooseOfMap(const Voices& voices, const MapMarginals& marginals,
                   std::pmr::memory_resource* memory) {
  Blocks blocks(memory);
  blocks.reserve(voices.size() * (voices.size() + 1) / 2);
  for (Voice* const voice : voices) {
    const Matrix6d* const own = marginals.find(voice->id());
    if (own == nullptr) continue;
    const std::size_t row = blocks.size();
    voice->of_map = std::ranges::all_of(voices, [&](const Voice* other) {
      if (!other->of_map) return true;
      blocks.push_back(marginals.findBetween(voice->id(), other->id()));
      return blocks.back() != nullptr;
    });
    if (voice->of_map) {
      blocks.push_back(own);
    } else {
      blocks.resize(row);
    }
  }
  return blocks;
}

double ofPlace(const Matrix6d& covariance) { return covariance.topLeftCorner<3, 3>().trace(); }

// What the map's errors add to the right side of the pose's normal equations.
struct MapSpread {
  Matrix6d covariance;
  // The places of the markers that hang on the leader are known much worse otherwise.
  bool doubted = false;
  PoseGlobalMatrix by_camera = PoseGlobalMatrix::Zero();
};

// sum_ij G_i E[delta_i delta_j^T] G_j^T of the chosen ones; the others hang on the first of them,
// with what their doubt has beyond that of this one, where it is much. Empty where the marginals
// know none.
std::optional<MapSpread> spreadOfMap(const Voices& voices, const MapMarginals& marginals,
                                     const PlaceDoubt& otherwise,
                                     std::pmr::memory_resource* memory) {
  const Blocks blocks = chooseOfMap(voices, marginals, memory);
  const auto found = std::ranges::find_if(voices, &Voice::of_map);
  if (found == voices.end()) return std::nullopt;
  Voice& leader = **found;
  const Eigen::Vector3d& p_w = leader.marker->T_w_m.p;
  Matrix6d hanging = Matrix6d::Zero();  // the others' gain, as of one rigid body there
  for (const Voice* const voice : voices) {
    if (voice->of_map) continue;
    hanging += voice->gain * rigidTransport(voice->marker->T_w_m.p - p_w);
  }
  leader.gain += hanging;
  MapSpread spread;
  // The sum is X + X^T; one product for each pair, and one for each row.
  Matrix6d X = Matrix6d::Zero();
  Matrix6d row;
  auto block = blocks.begin();
  for (const Voice* const a : voices) {
    if (!a->of_map) continue;
    row.setZero();
    for (const Voice* const b : voices) {
      if (b == a) break;
      if (!b->of_map) continue;
      const Matrix6d& shared = **block++;  // rows of the smaller id
      if (b->id() < a->id()) {
        row.noalias() += b->gain * shared;
      } else {
        row.noalias() += b->gain * shared.transpose();
      }
    }
    const Matrix6d half_of_own = 0.5 * **block++;
    row.noalias() += a->gain * half_of_own;
    X.noalias() += row * a->gain.transpose();
    const PoseGlobalMatrix* const by_camera = marginals.byCamera(a->id());
    if (by_camera != nullptr) spread.by_camera.noalias() += a->gain * *by_camera;
  }
  spread.covariance = X + X.transpose();
  if (hanging.isZero(0.0)) return spread;
  constexpr double kWorse = 4.0;  // as variances: what is less is how the two were computed
  const Matrix6d& known = *marginals.find(leader.id());
  const Matrix6d doubt = otherwise.at(p_w).covariance;
  spread.doubted = ofPlace(doubt) > kWorse * ofPlace(known);
  if (spread.doubted) {
    spread.covariance += hanging * excessOf(doubt, known) * hanging.transpose();
  }
  return spread;
}

bool isSame(double then, double now) { return std::abs(now - then) <= kSameVariance * then; }

}  // namespace

PlaceDoubt PlaceDoubt::at(const Eigen::Vector3d& point_w) const {
  const Matrix6d T = rigidTransport(point_w - p_w);
  return {point_w, T * covariance * T.transpose(), T * by_camera};
}

std::optional<WorldCovariance> worldCovariance(const PoseSolution& solution,
                                               std::span<const KnownMarker> markers,
                                               const MapMarginals& marginals,
                                               const PlaceDoubt& otherwise) {
  StackArena<24576> arena;
  std::pmr::vector<Voice> voices(arena.get());
  voices.reserve(markers.size());
  Matrix6d H = Matrix6d::Zero();
  Matrix6d noise = Matrix6d::Zero();
  for (std::size_t i = 0; i < markers.size(); ++i) {
    if (!solution.inlier[i]) continue;
    const KnownMarker& marker = markers[i];
    const auto information = markerInformation(marker.T_w_m, marker.size_m, *marker.detection,
                                               solution.T_w_c, marker.covariance);
    if (!information) continue;
    const Eigen::Vector3d d_w = marker.T_w_m.p - solution.T_w_c.p;
    Voice& voice = voices.emplace_back();
    voice.marker = &marker;
    voice.gain = transposedTransport(d_w, information->weighted);
    voice.information = information->weighted.topLeftCorner<3, 3>().trace();
    H += transposedTransport<6>(d_w, voice.gain.transpose());
    const Matrix6d TtN = transposedTransport(d_w, information->noise);
    noise += transposedTransport<6>(d_w, TtN.transpose());
  }
  const auto H_inverse = inverseOf(H);
  if (!H_inverse) return std::nullopt;

  WorldCovariance result;
  const auto atCamera = [&](const Matrix6d& spread) {
    return Matrix6d(*H_inverse * spread * *H_inverse);
  };
  Voices in_order(arena.get());
  in_order.reserve(voices.size());
  for (Voice& voice : voices) in_order.push_back(&voice);
  std::ranges::sort(in_order, std::ranges::greater{}, &Voice::information);
  const Eigen::Vector3d& p_w = solution.T_w_c.p;
  if (const auto spread = spreadOfMap(in_order, marginals, otherwise, arena.get())) {
    const PlaceDoubt doubt{p_w, atCamera(spread->covariance), *H_inverse * spread->by_camera};
    // Markers that agree with each other leave no more open than the doubt of all of them.
    const bool is_less =
        !spread->doubted || ofPlace(doubt.covariance) <= ofPlace(otherwise.at(p_w).covariance);
    if (is_less) result.doubt = doubt;
  }
  result.of_map = result.doubt ? result.doubt->covariance : otherwise.at(p_w).covariance;
  result.of_corners = atCamera(noise);
  if (!std::ranges::all_of(voices, &Voice::of_map)) {
    Matrix6d own = Matrix6d::Zero();
    for (const Voice& voice : voices) {
      if (voice.of_map) continue;
      own.noalias() += voice.gain * voice.marker->covariance * voice.gain.transpose();
    }
    result.of_new_markers = atCamera(own);
  }
  result.covariance =
      result.of_map + result.of_new_markers + solution.residual_variance * result.of_corners;
  return result;
}

KeptPoseCovariance::View KeptPoseCovariance::viewOf(const PoseSolution& solution,
                                                    std::span<const KnownMarker> markers) {
  View view;
  double nearest2 = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < markers.size(); ++i) {
    if (!solution.inlier[i]) continue;
    const KnownMarker& marker = markers[i];
    nearest2 = std::min(nearest2, (marker.T_w_m.p - solution.T_w_c.p).squaredNorm());
    for (const Eigen::Matrix2d& corner : marker.detection->covariance) {
      view.corners += corner.trace();
    }
    view.places_m2 += marker.covariance.diagonal().head<3>().sum();
    view.attitudes_r2 += marker.covariance.diagonal().tail<3>().sum();
  }
  view.nearest_m = std::sqrt(nearest2);
  return view;
}

bool KeptPoseCovariance::areTheSame(const PoseSolution& solution,
                                    std::span<const KnownMarker> markers) const {
  auto id = ids_.begin();
  for (std::size_t i = 0; i < markers.size(); ++i) {
    if (!solution.inlier[i]) continue;
    if (id == ids_.end() || *id++ != markers[i].detection->id) return false;
  }
  return id == ids_.end();
}

std::optional<WorldCovariance> KeptPoseCovariance::find(
    const PoseSolution& solution, std::span<const KnownMarker> markers) const {
  if (!kept_ || !areTheSame(solution, markers)) return std::nullopt;
  const Transform& T_w_c = solution.T_w_c;
  if ((T_w_c.p - T_w_c_.p).norm() > kSameDistance * view_.nearest_m ||
      rotationDistance(T_w_c.R, T_w_c_.R) > kSameView_rad) {
    return std::nullopt;
  }
  const View view = viewOf(solution, markers);
  if (!isSame(view_.corners, view.corners) || !isSame(view_.places_m2, view.places_m2) ||
      !isSame(view_.attitudes_r2, view.attitudes_r2)) {
    return std::nullopt;
  }
  WorldCovariance here = *kept_;
  if (here.doubt) {
    here.doubt = here.doubt->at(T_w_c.p);
    here.of_map = here.doubt->covariance;
  } else {
    const Matrix6d T = rigidTransport(T_w_c.p - T_w_c_.p);
    here.of_map = T * here.of_map * T.transpose();
  }
  here.covariance =
      here.of_map + here.of_new_markers + solution.residual_variance * here.of_corners;
  return here;
}

void KeptPoseCovariance::keep(const WorldCovariance& covariance, const PoseSolution& solution,
                              std::span<const KnownMarker> markers) {
  kept_ = covariance;
  T_w_c_ = solution.T_w_c;
  view_ = viewOf(solution, markers);
  constexpr std::size_t kUsual = 64;  // more are seldom in view: steady tracking takes no memory
  ids_.clear();
  ids_.reserve(std::max(markers.size(), kUsual));
  for (std::size_t i = 0; i < markers.size(); ++i) {
    if (solution.inlier[i]) ids_.push_back(markers[i].detection->id);
  }
}

}  // namespace waymark::slam
