#include "slam/covariance/map_covariance.h"

#include <utility>

#include "slam/covariance/marginal_recovery.h"
#include "slam/covariance/pose_by_camera.h"
#include "slam/geometry/turned_covariance.h"
#include "slam/option_checks.h"

namespace waymark::slam {

std::string MapCovarianceOptions::invalidReason() const {
  return firstUnmet({
      {isPositive(cost_per_frame), "cost_per_frame must be positive"},
      {isNotNegative(rest) && rest <= 1000.0, "the rest after a recovery must be from 0 to 1000"},
      {isShare(repeated_share), "the repeated share of a corner's error must be from 0 to 1"},
  });
}

MapCovariance::MapCovariance(const MarkerOptions& markers, const MapCovarianceOptions& options,
                             const CameraUncertainty& camera, const Map& map, bool grows)
    : markers_(markers),
      options_(options),
      camera_(camera),
      grows_(grows),
      due_(!map.keyframes().empty()) {
  for (const auto& [id, marker] : map.markers()) {
    if (marker.T_w_m) marginals_.set(id, marker.world_covariance);
  }
}

bool MapCovariance::work(double residual_sigma, Map* map) {
  if (!options_.enabled) return false;
  if (recovery_ && epoch_ != map->epoch()) {
    recovery_.reset();  // of coordinates that are no more
    due_ = true;
  }
  if (!recovery_) {
    if (epoch_ != map->epoch()) rest_frames_ = 0;  // what is known is of other coordinates
    if (rest_frames_ > 0) {
      --rest_frames_;
      return false;
    }
    if (!std::exchange(due_, false)) return false;
    frames_ = 0;
    epoch_ = map->epoch();
    recovery_.emplace([&](Budget* budget) {
      return recoverMarginals(*map, markers_, camera_, residual_sigma, budget, &kept_);
    });
  }
  ++frames_;
  if (!recovery_->advance(options_.cost_per_frame)) return false;
  rest_frames_ = static_cast<int>(options_.rest * frames_);
  MapMarginals marginals = recovery_->take();
  recovery_.reset();
  adopt(std::move(marginals), map);
  return grows_;
}

void MapCovariance::recover(double residual_sigma, Map* map) {
  if (!options_.enabled) return;
  recovery_.reset();
  due_ = false;
  adopt(runToCompletion([&](Budget* budget) {
          return recoverMarginals(*map, markers_, camera_, residual_sigma, budget, &kept_);
        }),
        map);
}

void MapCovariance::adopt(MapMarginals marginals, Map* map) {
  if (marginals.empty()) return;
  for (const auto& [id, covariance] : marginals.markers()) {
    const MapMarker* const marker = grows_ ? map->findPosed(id) : nullptr;
    if (marker == nullptr) continue;
    Matrix6d told = covariance + repeatedOf(*map, *marker);
    if (const PoseGlobalMatrix* const by_camera = marginals.byCamera(id)) {
      told += covarianceByCamera(camera_, *by_camera);
    }
    map->setWorldCovariance(id, told);
  }
  marginals_ = std::move(marginals);
  followed_.forget();
}

// The covariance that the keyframes leave it falls with their number; this part does not.
Matrix6d MapCovariance::repeatedOf(const Map& map, const MapMarker& marker) const {
  const std::size_t views = map.viewsOf(marker.id).size();
  if (views < 2) return Matrix6d::Zero();
  const double variance = options_.repeated_share * options_.repeated_share;
  return variance * static_cast<double>(views - 1) * marker.covariance;
}

void MapCovariance::introduce(int marker, const Transform& T_w_c, const Matrix6d& pose_covariance,
                              Map* map) {
  const MapMarker* const known = map->findPosed(marker);
  if (!options_.enabled || known == nullptr) return;
  const Matrix6d T = rigidTransport(known->T_w_m->p - T_w_c.p);
  const Matrix6d covariance = T * pose_covariance * T.transpose() + known->covariance;
  marginals_.set(marker, covariance);
  followed_.forget();
  map->setWorldCovariance(marker, covariance);
}

Matrix6d MapCovariance::inWorld(const PoseSolution& solution, std::span<const KnownMarker> markers,
                                const PoseGlobalMatrix& in_view) const {
  const auto in_world =
      options_.enabled ? worldCovariance(solution, markers, marginals_, doubt_) : std::nullopt;
  if (!in_world) return solution.covariance + covarianceByCamera(camera_, in_view);
  const PlaceDoubt& doubt = in_world->doubt ? *in_world->doubt : doubt_;
  const PoseGlobalMatrix in_map = doubt.at(solution.T_w_c.p).by_camera;
  return in_world->covariance + covarianceByCamera(camera_, in_view + in_map);
}

Matrix6d MapCovariance::sharedAt(const Eigen::Vector3d& p_w) const {
  if (!options_.enabled) return Matrix6d::Zero();
  return doubt_.at(p_w).covariance;
}

PoseGlobalMatrix MapCovariance::sharedByCamera(const Eigen::Vector3d& p_w) const {
  if (!options_.enabled) return PoseGlobalMatrix::Zero();
  return doubt_.at(p_w).by_camera;
}

void MapCovariance::doubtAs(const MapMarker& marker) {
  followed_.forget();
  const Matrix6d* const known = marginals_.find(marker.id);
  const PoseGlobalMatrix* const by_camera = marginals_.byCamera(marker.id);
  doubt_ = {marker.T_w_m->p, known == nullptr ? marker.world_covariance : *known,
            by_camera == nullptr ? PoseGlobalMatrix(PoseGlobalMatrix::Zero()) : *by_camera};
}

bool MapCovariance::doubtIfLess(const MapMarker& marker, const Eigen::Vector3d& p_w) {
  const PlaceDoubt before = doubt_;
  const auto here = [&] { return sharedAt(p_w).topLeftCorner<3, 3>().trace(); };
  const double was = here();
  doubtAs(marker);
  if (here() < was) return true;
  doubt_ = before;
  return false;
}

Matrix6d MapCovariance::follow(const PoseSolution& solution, std::span<const KnownMarker> markers) {
  if (!options_.enabled) return solution.covariance;
  auto in_world = followed_.find(solution, markers);
  if (!in_world) {
    in_world = worldCovariance(solution, markers, marginals_, doubt_);
    if (in_world) followed_.keep(*in_world, solution, markers);
  }
  if (!in_world) return solution.covariance;
  if (in_world->doubt) doubt_ = *in_world->doubt;
  return in_world->covariance;
}

}  // namespace waymark::slam
