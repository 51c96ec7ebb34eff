#include "slam/optimisation/map_optimiser.h"

#include <limits>
#include <map>
#include <utility>
#include <vector>

#include "slam/geometry/robust.h"
#include "slam/rolling_shutter/rolling_shutter.h"

namespace waymark::slam {
namespace {

// Takes part in the problem; the value says whether it is held fixed.
using KeyframeRoles = std::map<KeyframeId, bool>;

// A part of the map as a bundle problem, and the way back.
class MapProblem {
 public:
  MapProblem(const Map& map, const KeyframeRoles& roles, std::span<const int> marker_ids,
             const MarkerOptions& markers) {
    addMarkers(map, marker_ids, markers);
    addKeyframes(map, roles, markers);
  }

  BundleProblem problem;

  // The readout time as an unknown: where the corners would have moved with another one.
  void freeReadout(const Map& map, double readout_s, const CameraModel& camera) {
    BundleProblem::Shutter shutter;
    shutter.readout_s = shutter.corrected_with_s = readout_s;
    for (const auto& observation : problem.observations) {
      const auto c = static_cast<std::size_t>(observation.camera);
      const auto m = static_cast<std::size_t>(observation.marker);
      const Transform& T_w_c = problem.cameras[c].T;
      const Vector6d& twist = map.keyframes().at(keyframes_[c]).twist;
      const auto corners = markerCorners(problem.marker_sizes_m[m]);
      auto& motion = shutter.motion.emplace_back();
      for (std::size_t k = 0; k < 4; ++k) {
        const Eigen::Vector3d p_c = T_w_c.inverse() * (problem.markers[m].T * corners[k]);
        motion[k] = rowTime(observation.detection->pixels[k].y(), camera.height()) *
                    imageVelocity(p_c, twist);
      }
    }
    problem.shutter = std::move(shutter);
  }

  BundleSummary optimise(Map* map, const BundleOptions& options) {
    BundleAdjuster adjuster(std::move(problem), options);
    (void)inOneGo([&](Allowance* allowance) { return adjuster.run(allowance); });
    problem = adjuster.problem();
    for (std::size_t c = 0; c < keyframes_.size(); ++c) {
      map->keyframePose(keyframes_[c]) = problem.cameras[c].T;
    }
    for (const auto& [id, index] : marker_index_) {
      MapMarker& marker = map->marker(id);
      marker.T_w_m = problem.markers[static_cast<std::size_t>(index)].T;
      marker.covariance = adjuster.markerCovariance(index);
    }
    return adjuster.summary();
  }

  // As it is, without optimising anything.
  [[nodiscard]] MapFit fit() const {
    MapFit fit;
    const auto whitened = inOneGo([&](Allowance* a) { return whitenCorners(problem, a); });
    if (inOneGo([&](Allowance* a) { return cornerErrors(problem, whitened, &fit.squared, a); })) {
      fit.noise = noiseScale(fit.squared);
    } else {
      fit.squared.assign(4 * problem.observations.size(), std::numeric_limits<double>::infinity());
    }
    return fit;
  }

 private:
  void addMarkers(const Map& map, std::span<const int> marker_ids, const MarkerOptions& markers) {
    for (const int id : marker_ids) {
      const MapMarker* marker = map.findPosed(id);
      if (marker == nullptr) continue;
      marker_index_[id] = static_cast<int>(problem.markers.size());
      problem.markers.push_back({*marker->T_w_m, markers.origin_marker == id});
      problem.marker_sizes_m.push_back(marker->size_m);
    }
    for (const Anchor& anchor : markers.anchors) {
      const auto found = marker_index_.find(anchor.id);
      if (found == marker_index_.end()) continue;
      Vector6d information;
      information << Eigen::Vector3d::Constant(1.0 / (anchor.sigma_m * anchor.sigma_m)),
          Eigen::Vector3d::Constant(1.0 / (anchor.sigma_rad * anchor.sigma_rad));
      problem.priors.push_back({found->second, anchor.T_w_m, information.asDiagonal()});
    }
  }

  void addKeyframes(const Map& map, const KeyframeRoles& roles, const MarkerOptions& markers) {
    const bool first_is_world = !markers.origin_marker && markers.anchors.empty();
    for (const auto& [id, held] : roles) {
      const Keyframe& keyframe = map.keyframes().at(id);
      const int camera = static_cast<int>(problem.cameras.size());
      const std::size_t before = problem.observations.size();
      for (const MarkerDetection& detection : keyframe.detections) {
        const auto found = marker_index_.find(detection.id);
        if (found == marker_index_.end()) continue;
        problem.observations.push_back({camera, found->second, &detection});
      }
      if (problem.observations.size() == before) continue;
      const bool is_world = first_is_world && id == map.keyframes().begin()->first;
      problem.cameras.push_back({keyframe.T_w_c, held || is_world});
      keyframes_.push_back(id);
    }
  }

  std::map<int, int> marker_index_;    // by id
  std::vector<KeyframeId> keyframes_;  // by camera
};

MapProblem wholeMap(const Map& map, const MarkerOptions& markers) {
  KeyframeRoles roles;
  for (const auto& [id, keyframe] : map.keyframes()) roles[id] = false;
  std::vector<int> ids;
  for (const auto& [id, marker] : map.markers()) ids.push_back(id);
  return {map, roles, ids, markers};
}

// The newest keyframes and what they see; the oldest of them holds the gauge.
MapProblem newestPart(const Map& map, int keyframes, const MarkerOptions& markers) {
  KeyframeRoles roles;
  std::vector<KeyframeId> ids;
  for (auto it = map.keyframes().rbegin(); it != map.keyframes().rend(); ++it) {
    if (static_cast<int>(ids.size()) == keyframes) break;
    ids.push_back(it->first);
    roles[it->first] = false;
  }
  roles[ids.back()] = true;
  return {map, roles, map.markersSeenFrom(ids), markers};
}

}  // namespace

IntrinsicVector IntrinsicPriors::sigmas() const {
  IntrinsicVector sigmas;
  sigmas << focal_px, focal_px, centre_px, centre_px, distortion, distortion, distortion,
      distortion, distortion;
  return sigmas;
}

BundleSummary optimiseLocally(Map* map, KeyframeId keyframe, const MarkerOptions& markers,
                              const BundleOptions& options) {
  const std::vector<KeyframeId> near = map->neighbours(keyframe);
  const std::vector<int> marker_ids = map->markersSeenFrom(near);
  KeyframeRoles roles;
  for (const int id : marker_ids) {
    if (map->findPosed(id) == nullptr) continue;
    for (const KeyframeId view : map->viewsOf(id)) roles[view] = true;
  }
  for (const KeyframeId id : near) roles[id] = false;
  return MapProblem(*map, roles, marker_ids, markers).optimise(map, options);
}

BundleSummary optimiseGlobally(Map* map, const MarkerOptions& markers,
                               const BundleOptions& options) {
  return wholeMap(*map, markers).optimise(map, options);
}

BundleSummary optimiseGloballyWithIntrinsics(Map* map, const MarkerOptions& markers,
                                             const IntrinsicVector& expected,
                                             const IntrinsicPriors& priors, double readout_s,
                                             const BundleOptions& options, CameraModel* camera) {
  MapProblem whole = wholeMap(*map, markers);
  whole.problem.lens = {*camera, *camera, expected, priors.sigmas()};
  const BundleSummary summary = whole.optimise(map, options);
  if (summary.failed) return summary;
  *camera = whole.problem.lens->camera;
  map->undistortAgain(*camera, readout_s);
  return summary;
}

std::optional<ReadoutEstimate> estimateReadout(const Map& map, const MarkerOptions& markers,
                                               double readout_s, const CameraModel& camera,
                                               int keyframes, const BundleOptions& options) {
  MapProblem newest = newestPart(map, keyframes, markers);
  newest.freeReadout(map, readout_s, camera);
  BundleAdjuster adjuster(std::move(newest.problem), options);
  (void)inOneGo([&](Allowance* a) { return adjuster.run(a); });
  const auto sigma_s = inOneGo([&](Allowance* a) { return adjuster.readoutSigma_s(a); });
  if (adjuster.summary().failed || !sigma_s) return std::nullopt;
  return ReadoutEstimate{adjuster.problem().shutter->readout_s, *sigma_s};
}

double MapFit::cost(double huber) const {
  double sum = 0.0;
  for (const double error : squared) sum += huberCost(error, huber);
  return sum;
}

double MapFit::meanCost(double huber) const {
  return squared.empty() ? 0.0 : cost(huber) / static_cast<double>(squared.size());
}

MapFit fitOf(const Map& map) { return wholeMap(map, {}).fit(); }

MapFit fitOf(const Map& map, std::span<const KeyframeId> keyframes) {
  KeyframeRoles roles;
  for (const KeyframeId id : keyframes) roles[id] = false;
  return MapProblem(map, roles, map.markersSeenFrom(keyframes), {}).fit();
}

}  // namespace waymark::slam
