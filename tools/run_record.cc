#include "tools/run_record.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <utility>

#include <nlohmann/json.hpp>

namespace waymark::tools {
namespace {

using Json = nlohmann::ordered_json;

std::size_t posedMarkers(const slam::Map& map) {
  return static_cast<std::size_t>(
      std::count_if(map.markers().begin(), map.markers().end(),
                    [](const auto& entry) { return entry.second.T_w_m.has_value(); }));
}

}  // namespace

void RunRecord::add(std::int64_t time_ns, const slam::FrameResult& result,
                    const slam::Counters& counters) {
  if (counters.loop_closures > loop_closures_) loop_closed_at_ns_.push_back(time_ns);
  loop_closures_ = counters.loop_closures;
  if (result.pose) {
    if (!initialized_at_) initialized_at_ = frames_.size();
    ++localized_;
  }
  frames_.push_back({time_ns, result.pose, {result.detections.begin(), result.detections.end()}});
}

void RunRecord::undistortAgain(const slam::CameraModel& camera) {
  for (FrameRecord& frame : frames_) {
    std::vector<slam::MarkerDetection> seen;
    for (slam::MarkerDetection& detection : frame.detections) {
      if (slam::undistortCorners(camera, &detection)) seen.push_back(detection);
    }
    frame.detections = std::move(seen);
  }
}

std::optional<slam::PoseEstimate> RunRecord::firstPose() const {
  return initialized_at_ ? frames_[*initialized_at_].pose : std::nullopt;
}

double RunRecord::localizedPercent() const {
  if (frames_.empty()) return 0.0;
  return 100.0 * static_cast<double>(localized_) / static_cast<double>(frames_.size());
}

io::Trajectory RunRecord::liveTrajectory() const {
  io::Trajectory trajectory;
  for (const FrameRecord& frame : frames_) {
    if (frame.pose) trajectory.push_back({frame.time_ns, frame.pose->T_w_c});
  }
  return trajectory;
}

io::Trajectory RunRecord::finalTrajectory(const slam::Slam& slam) const {
  std::vector<std::optional<slam::Transform>> poses(frames_.size());
  // A frame that was lost live starts from its neighbour: first the one before, then, for the
  // frames in front of the first pose, the one after.
  std::optional<slam::Transform> neighbour;
  const auto localize = [&](std::size_t i) {
    if (!poses[i]) {
      const auto& live = frames_[i].pose;
      const std::optional<slam::Transform> guess = live ? live->T_w_c : neighbour;
      if (!guess) return;
      const slam::Vector6d twist = live ? live->twist : slam::Vector6d::Zero();
      const auto pose =
          slam.localize({i, frames_[i].time_ns, frames_[i].detections, *guess, twist});
      if (pose) poses[i] = pose->T_w_c;
    }
    if (poses[i]) neighbour = poses[i];
  };
  for (std::size_t i = 0; i < frames_.size(); ++i) localize(i);
  neighbour.reset();
  for (std::size_t i = frames_.size(); i-- > 0;) localize(i);

  io::Trajectory trajectory;
  for (std::size_t i = 0; i < frames_.size(); ++i) {
    if (poses[i]) trajectory.push_back({frames_[i].time_ns, *poses[i]});
  }
  return trajectory;
}

std::vector<io::RecordedFrame> RunRecord::recordedFrames() const {
  std::vector<io::RecordedFrame> recorded;
  recorded.reserve(frames_.size());
  for (const FrameRecord& frame : frames_) recorded.push_back({frame.time_ns, frame.detections});
  return recorded;
}

std::vector<bool> RunRecord::spread(std::size_t count, std::size_t views_per_marker) const {
  std::vector<bool> chosen(frames_.size(), false);
  const auto chooseEvenly = [&chosen](const std::vector<std::size_t>& from, std::size_t wanted) {
    for (std::size_t k = 0; k < std::min(wanted, from.size()); ++k) {
      chosen[from[k * from.size() / std::min(wanted, from.size())]] = true;
    }
  };
  std::vector<std::size_t> all(frames_.size());
  std::iota(all.begin(), all.end(), std::size_t{0});
  chooseEvenly(all, count);
  std::map<int, std::vector<std::size_t>> seen_in;  // frames by marker
  for (const std::size_t i : all) {
    for (const auto& detection : frames_[i].detections) seen_in[detection.id].push_back(i);
  }
  for (const auto& [id, frames] : seen_in) {
    const auto views = static_cast<std::size_t>(
        std::count_if(frames.begin(), frames.end(), [&](std::size_t i) { return chosen[i]; }));
    if (views < views_per_marker) chooseEvenly(frames, views_per_marker);
  }
  return chosen;
}

std::vector<slam::RecordedFrame> RunRecord::spreadFrames(std::size_t count,
                                                         std::size_t views_per_marker) const {
  std::vector<slam::RecordedFrame> frames;
  std::optional<slam::PoseEstimate> near = firstPose();
  if (!near) return frames;
  const std::vector<bool> chosen = spread(count, views_per_marker);
  for (std::size_t i = 0; i < frames_.size(); ++i) {
    const FrameRecord& frame = frames_[i];
    if (frame.pose) near = frame.pose;
    if (!chosen[i]) continue;
    frames.push_back({i, frame.time_ns, frame.detections, near->T_w_c,
                      frame.pose ? frame.pose->twist : slam::Vector6d::Zero()});
  }
  return frames;
}

std::vector<slam::RecordedFrame> RunRecord::framesWithoutPose() const {
  std::vector<slam::RecordedFrame> frames;
  for (std::size_t i = 0; i < frames_.size(); ++i) {
    const FrameRecord& frame = frames_[i];
    if (!frame.pose)
      frames.push_back({i, frame.time_ns, frame.detections, {}, slam::Vector6d::Zero()});
  }
  return frames;
}

std::string RunRecord::statistics(const slam::Slam& slam, const StageTimer& timer,
                                  std::uint64_t dropped_late) const {
  const slam::Counters& counters = slam.counters();
  double squares_px2 = 0.0;  // of each frame's RMS
  for (const FrameRecord& frame : frames_) {
    if (frame.pose) squares_px2 += std::pow(frame.pose->reprojection_rms_px, 2);
  }
  const Json none = nullptr;
  Json json;
  json["frames"] = frames_.size();
  json["localized"] = localized_;
  json["initialized_at_frame"] = initialized_at_ ? Json(*initialized_at_) : none;
  json["keyframes"] = slam.map().keyframes().size();
  json["markers"] = posedMarkers(slam.map());
  json["loop_closures"] = counters.loop_closures;
  json["loop_closed_at_s"] = Json::array();
  for (const std::int64_t time_ns : loop_closed_at_ns_) {
    json["loop_closed_at_s"].push_back(1e-9 * static_cast<double>(time_ns));
  }
  json["relocalizations"] = counters.relocalizations;
  json["reprojection_rms_px"] =
      localized_ > 0 ? Json(std::sqrt(squares_px2 / static_cast<double>(localized_))) : none;
  Json others = Json::object();  // than those above
  for (const slam::NamedCounter& counter : slam::kCounters) {
    if (!json.contains(counter.name)) others[counter.name] = counters.*counter.value;
  }
  others["dropped_late"] = dropped_late;
  json["counters"] = std::move(others);
  json["timing"] = timer.json();
  return json.dump(2) + "\n";
}

}  // namespace waymark::tools
