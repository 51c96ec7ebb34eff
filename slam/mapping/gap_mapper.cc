#include "slam/mapping/gap_mapper.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <Eigen/Cholesky>

#include "base/elapsed.h"
#include "slam/covariance/excess_covariance.h"
#include "slam/covariance/marginals.h"
#include "slam/geometry/turned_covariance.h"
#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

// Seen, and neither placed nor found to be untrustworthy.
bool isNew(const Map& map, int id) {
  const MapMarker* const marker = map.find(id);
  return marker == nullptr || marker->state == MarkerState::kUnresolved;
}

}  // namespace

std::string GapMapperOptions::invalidReason() const {
  return firstUnmet({
      {isPositive(min_baseline_per_distance), "the baseline of carried views must be positive"},
      {views >= 3, "a new marker needs at least 3 carried views"},
      {nearer_share > 0.0 && nearer_share < 1.0,
       "nearer views must be from a share of the distance"},
      {isPositive(out_of_sight_s), "the time until a marker is out of sight must be positive"},
      {isPositive(most_carried_sigmas),
       "how far carried poses may be off must be a positive number of standard deviations"},
      {isPositive(max_pause_s), "the pause between carried views must be positive"},
  });
}

std::optional<MarkerLink> linkTo(int marker, const Transform& T_w_m, const Transform& T_w_c,
                                 const Matrix6d& covariance) {
  // The camera's error is the marker's, seen from the camera, the other way round.
  const Matrix6d T = rigidTransport(T_w_m.p - T_w_c.p);
  MarkerLink link{marker, T_w_c.inverse() * T_w_m,
                  turnedCovariance(T_w_c.R.transpose(), T * covariance * T.transpose())};
  link.covariance = (0.5 * (link.covariance + link.covariance.transpose())).eval();
  if (!link.covariance.allFinite() || link.covariance.llt().info() != Eigen::Success) {
    return std::nullopt;
  }
  return link;
}

std::optional<GapJoint> GapMapper::offer(const CarriedFrame& frame, const Map& map,
                                         double residual_sigma) {
  const auto passed_s = [&](const Sighting& sighting) {
    return secondsBetween(sighting.last_seen_ns, frame.time.monotonic_ns);
  };
  std::erase_if(sightings_,
                [&](const auto& entry) { return passed_s(entry.second) > options_.max_pause_s; });
  look(frame, map);
  for (auto& [id, sighting] : sightings_) {
    const MapMarker* const anchor = map.findPosed(sighting.anchor);
    const bool enough =
        sighting.views.size() >= options_.views || passed_s(sighting) > options_.out_of_sight_s;
    if (anchor == nullptr || !enough || sighting.undecided) continue;
    auto joint = decide(sighting, *anchor, residual_sigma);
    sighting.undecided = !joint;
    if (!joint) continue;
    noteJoint(*joint, sighting.views.back(), *anchor);
    sightings_.erase(id);
    has_joined_ = true;
    return joint;
  }
  return std::nullopt;
}

std::optional<Keyframe> GapMapper::arrive(const CarriedFrame& frame, const Map& map) const {
  const MapMarker* const anchor = map.findPosed(frame.anchor);
  const auto is_anchor = [&](const MarkerDetection& d) { return d.id == frame.anchor; };
  if (has_joined_ || anchor == nullptr || frame.detections.empty() ||
      std::ranges::any_of(frame.detections, is_anchor)) {
    return std::nullopt;
  }
  const auto link = linkTo(anchor->id, *anchor->T_w_m, frame.T_w_c, frame.covariance);
  if (!link) return std::nullopt;
  // From where features have the camera, not from one of a single marker's two poses.
  return Keyframe{.sequence = frame.time.sequence,
                  .monotonic_ns = frame.time.monotonic_ns,
                  .T_w_c = frame.T_w_c,
                  .detections = {frame.detections.begin(), frame.detections.end()},
                  .twist = frame.twist,
                  .links = {*link}};
}

void GapMapper::noteJoint(const GapJoint& joint, const View& last, const MapMarker& anchor) {
  const Transform T_anchor_c = anchor.T_w_m->inverse() * last.T_w_c;
  nearing_ = Nearing{
      .marker = joint.marker.id,
      .anchor = anchor.id,
      .joined = joint.keyframes.size(),
      .distance_m = (joint.marker.T_w_m.p - last.T_w_c.p).norm(),
      .left = options_.nearer_views,
      .p_anchor_c = T_anchor_c.p,
      .covariance = turnedCovariance(anchor.T_w_m->R.transpose(), last.covariance),
  };
}

std::optional<Keyframe> GapMapper::comeNearer(const CarriedFrame& frame, const Map& map) {
  if (!nearing_ || nearing_->left == 0) return std::nullopt;
  const auto detection =
      std::ranges::find(frame.detections, nearing_->marker, &MarkerDetection::id);
  const MapMarker* const anchor = map.findPosed(nearing_->anchor);
  if (detection == frame.detections.end() || anchor == nullptr) return std::nullopt;
  const double distance_m = distanceTo(*detection);
  if (distance_m > options_.nearer_share * nearing_->distance_m) return std::nullopt;
  // The marker's place is from this stretch: what it tells of the camera's is not new.
  const Transform& T_w_anchor = *anchor->T_w_m;
  const Matrix6d F = rigidTransport(frame.T_w_c.p - T_w_anchor * nearing_->p_anchor_c);
  const Matrix6d before = turnedCovariance(T_w_anchor.R, nearing_->covariance);
  const Matrix6d carried = F * before * F.transpose();
  const View view{*detection, frame.time, frame.T_w_c,
                  carried + excessOf(frame.covariance, carried), frame.twist};
  auto keyframe = keyframeOf(view, *anchor, nearing_->joined);
  if (!keyframe) return std::nullopt;
  nearing_->distance_m = distance_m;
  --nearing_->left;
  return keyframe;
}

void GapMapper::look(const CarriedFrame& frame, const Map& map) {
  for (const MarkerDetection& detection : frame.detections) {
    if (!isNew(map, detection.id)) continue;
    Sighting& sighting = sightings_[detection.id];
    if (sighting.anchor != frame.anchor) sighting = {.views = {}, .anchor = frame.anchor};
    sighting.last_seen_ns = frame.time.monotonic_ns;
    std::vector<View>& views = sighting.views;
    if (!views.empty() && !isAnotherView(views.back(), detection, frame.T_w_c)) continue;
    if (views.size() == options_.views) views.erase(views.begin());
    views.push_back({detection, frame.time, frame.T_w_c, frame.covariance, frame.twist});
    sighting.undecided = false;
  }
}

double GapMapper::distanceTo(const MarkerDetection& detection) const {
  // A square of that side is about so wide at a distance of 1 m.
  double side = 0.0;
  for (std::size_t k = 0; k < 4; ++k) {
    side = std::max(side, (detection.normalized[(k + 1) % 4] - detection.normalized[k]).norm());
  }
  return markers_.sizeOf(detection.id) / side;
}

bool GapMapper::isAnotherView(const View& last, const MarkerDetection& detection,
                              const Transform& T_w_c) const {
  return (T_w_c.p - last.T_w_c.p).norm() >=
         options_.min_baseline_per_distance * distanceTo(detection);
}

std::optional<GapJoint> GapMapper::decide(const Sighting& sighting, const MapMarker& anchor,
                                          double residual_sigma) const {
  const int id = sighting.views.front().detection.id;
  std::vector<MarkerView> seen;
  seen.reserve(sighting.views.size());
  for (const View& view : sighting.views) seen.push_back({&view.detection, view.T_w_c});
  const MarkerResolution found =
      resolveMarkerPose(seen, markers_.sizeOf(id), focal_px_, residual_sigma, resolver_);
  if (found.verdict == ResolverVerdict::kContradictory) return decideAlone(sighting, anchor);
  if (found.verdict != ResolverVerdict::kResolved) return std::nullopt;
  GapJoint joint;
  joint.marker = {id, found.T_w_m, found.other_T_w_m};
  for (const View& view : sighting.views) {
    auto keyframe = keyframeOf(view, anchor, sighting.views.size());
    if (!keyframe) return std::nullopt;
    joint.keyframes.push_back(std::move(*keyframe));
  }
  return joint;
}

Eigen::Matrix3d GapMapper::LoneView::carriedCovariance() const {
  const Matrix6d T = rigidTransport(place() - view->T_w_c.p);
  return (T * view->covariance * T.transpose()).topLeftCorner<3, 3>();
}

auto GapMapper::loneViews(const Sighting& sighting) const -> std::vector<LoneView> {
  std::vector<LoneView> all;
  for (const View& view : sighting.views) {
    const auto pose = estimateSquarePose(view.detection, markers_.sizeOf(view.detection.id),
                                         focal_px_, resolver_.square);
    if (pose) all.push_back({&view, *pose});
  }
  return all;
}

bool GapMapper::explainedByCarriedPoses(const LoneView& a, const LoneView& b) const {
  const Eigen::Vector3d apart = a.place() - b.place();
  const Eigen::Vector3d along = apart.normalized();
  // What both have in common moves them alike: at most this.
  const double variance = along.dot((a.carriedCovariance() + b.carriedCovariance()) * along);
  return apart.norm() <= options_.most_carried_sigmas * std::sqrt(variance);
}

std::optional<GapJoint> GapMapper::decideAlone(const Sighting& sighting,
                                               const MapMarker& anchor) const {
  const std::vector<LoneView> all = loneViews(sighting);
  const auto clearest =
      std::ranges::max_element(all, {}, [](const LoneView& lone) { return lone.pose.ratio; });
  if (clearest == all.end() || !clearest->pose.unambiguous(resolver_.ambiguity_ratio)) {
    return std::nullopt;
  }
  if (!std::ranges::all_of(
          all, [&](const LoneView& other) { return explainedByCarriedPoses(*clearest, other); })) {
    return std::nullopt;
  }
  const View& view = *clearest->view;
  const SquarePose& pose = clearest->pose;
  auto keyframe = keyframeOf(view, anchor, 1);
  if (!keyframe) return std::nullopt;
  GapJoint joint;
  joint.marker = {view.detection.id, view.T_w_c * pose.T_c_m[0], {}};
  if (!pose.unambiguous(resolver_.final_ratio)) {
    joint.marker.other_T_w_m = view.T_w_c * pose.T_c_m[1];
  }
  joint.keyframes.push_back(std::move(*keyframe));
  return joint;
}

std::optional<Keyframe> GapMapper::keyframeOf(const View& view, const MapMarker& anchor,
                                              std::size_t joined) const {
  const double links = static_cast<double>(joined + options_.nearer_views);
  const auto link = linkTo(anchor.id, *anchor.T_w_m, view.T_w_c, links * view.covariance);
  if (!link) return std::nullopt;
  return Keyframe{.sequence = view.time.sequence,
                  .monotonic_ns = view.time.monotonic_ns,
                  .T_w_c = view.T_w_c,
                  .detections = {view.detection},
                  .twist = view.twist,
                  .links = {*link}};
}

}  // namespace waymark::slam
