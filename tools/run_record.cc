#include "tools/run_record.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <nlohmann/json.hpp>

#include "slam/camera/corner_coverage.h"
#include "slam/final_trajectory.h"
#include "slam/photograph_order.h"

namespace waymark::tools {
namespace {

using Json = nlohmann::ordered_json;

// Of all pieces of the map.
std::size_t posedMarkers(const slam::Slam& slam) {
  std::ptrdiff_t count = 0;
  for (const slam::Map* map : slam.pieces()) {
    count += std::ranges::count_if(
        map->markers(), [](const auto& entry) { return entry.second.T_w_m.has_value(); });
  }
  return static_cast<std::size_t>(count);
}

io::FrameStatus statusOf(slam::TrackingState state) {
  switch (state) {
    case slam::TrackingState::kInitializing:
      return io::FrameStatus::kInitializing;
    case slam::TrackingState::kTracking:
      return io::FrameStatus::kTracking;
    case slam::TrackingState::kBridging:
      return io::FrameStatus::kBridging;
    case slam::TrackingState::kRelocalizing:
      return io::FrameStatus::kRelocalizing;
    case slam::TrackingState::kLost:
      return io::FrameStatus::kLost;
  }
  return io::FrameStatus::kInitializing;
}

// learned_at_ns: time of the frame since which it is.
Json lensOf(const slam::Slam& slam, std::optional<std::int64_t> learned_at_ns) {
  const slam::LensKnowledge& lens = slam.lens();
  const slam::Calibration& camera = slam.camera().calibration();
  Json json;
  json["state"] = slam::stateName(lens.state);
  json["learned_at_s"] =
      learned_at_ns ? Json(1e-9 * static_cast<double>(*learned_at_ns)) : Json(nullptr);
  json["model"] = camera.model == slam::DistortionModel::kEquidistant ? "equidistant" : "rational";
  json["fx"] = camera.fx;
  json["fy"] = camera.fy;
  json["cx"] = camera.cx;
  json["cy"] = camera.cy;
  json["distortion"] = camera.distortion;
  const bool learned = lens.state != slam::LensState::kGiven;
  const bool measured = lens.focalShare() > 0.0;
  json["focal_sigma_percent"] = measured ? Json(100.0 * lens.focalShare()) : Json(nullptr);
  json["rms_before_px"] = learned ? Json(lens.rms_before_px) : Json(nullptr);
  json["rms_after_px"] = learned ? Json(lens.rms_after_px) : Json(nullptr);
  json["changes"] = lens.changes;
  json["changed_at_s"] = Json::array();  // under way
  for (const slam::EarlierLens& earlier : lens.earlier) {
    json["changed_at_s"].push_back(1e-9 * static_cast<double>(earlier.until_ns));
  }
  json["coverage_percent"] =
      100.0 * static_cast<double>(slam.counters().image_cells_seen) / slam::CornerCoverage::kCells;
  return json;
}

}  // namespace

void RunRecord::add(std::int64_t time_ns, const slam::FrameResult& result,
                    const slam::Counters& counters, slam::LensState lens) {
  if (lens != slam::LensState::kLearned) {
    lens_learned_at_ns_.reset();
  } else if (!lens_learned_at_ns_) {
    lens_learned_at_ns_ = time_ns;
  }
  if (counters.loop_closures > loop_closures_) loop_closed_at_ns_.push_back(time_ns);
  loop_closures_ = counters.loop_closures;
  if (result.pose) count(*result.pose, frames());
  // Half of them at once: each frame is moved once at most.
  if (frames_.size() / 2 >= max_frames_) {
    const auto earliest = static_cast<std::ptrdiff_t>(max_frames_);
    frames_.erase(frames_.begin(), frames_.begin() + earliest);
    states_.erase(states_.begin(), states_.begin() + earliest);
    forgotten_ += max_frames_;
  }
  frames_.push_back({time_ns,
                     result.pose,
                     {result.detections.begin(), result.detections.end()},
                     {result.found.begin(), result.found.end()}});
  states_.push_back({result.state, result.reason});
}

void RunRecord::count(const slam::PoseEstimate& pose, std::size_t frame) {
  if (!initialized_at_) initialized_at_ = frame;
  ++localized_;
  if (pose.source != slam::PoseSource::kMarkers) return;
  ++by_markers_;
  squares_px2_ += std::pow(pose.reprojection_rms_px, 2);
}

void RunRecord::placeInOrder(slam::Slam* slam) {
  const std::vector<slam::Placement> placed = slam::placeInOrder(frames_, slam);
  localized_ = by_markers_ = 0;
  squares_px2_ = 0.0;
  initialized_at_.reset();
  for (std::size_t i = 0; i < placed.size(); ++i) {
    frames_[i].pose = placed[i].pose;
    states_[i] = {placed[i].state, placed[i].reason};
    if (placed[i].pose) count(*placed[i].pose, i);
  }
}

std::size_t keyframesOf(const slam::Slam& slam) {
  std::size_t count = 0;
  for (const slam::Map* map : slam.pieces()) count += map->keyframes().size();
  return count;
}

double RunRecord::localizedPercent() const {
  if (frames() == 0) return 0.0;
  return 100.0 * static_cast<double>(localized_) / static_cast<double>(frames());
}

std::map<slam::NoPoseReason, std::size_t> RunRecord::reasons() const {
  std::map<slam::NoPoseReason, std::size_t> counts;
  for (const LiveState& state : states_) {
    if (state.reason != slam::NoPoseReason::kNone) ++counts[state.reason];
  }
  return counts;
}

double RunRecord::reprojectionRms_px() const {
  return by_markers_ > 0 ? std::sqrt(squares_px2_ / static_cast<double>(by_markers_)) : 0.0;
}

std::vector<io::FramePose> RunRecord::livePoses() const {
  std::vector<io::FramePose> poses;
  poses.reserve(frames_.size());
  for (std::size_t i = 0; i < frames_.size(); ++i) {
    poses.push_back({frames_[i].monotonic_ns, forgotten_ + i, statusOf(states_[i].state),
                     frames_[i].pose, slam::describe(states_[i].reason)});
  }
  return poses;
}

std::vector<io::FramePose> RunRecord::finalPoses(const slam::Slam& slam,
                                                 bool unordered_images) const {
  const auto found = slam::localizeAll(frames_, {.unordered_images = unordered_images}, slam);
  const auto without_pose =
      posedMarkers(slam) > 0 ? io::FrameStatus::kLost : io::FrameStatus::kInitializing;
  const auto statusOf = [&](const std::optional<slam::PoseEstimate>& pose) {
    if (!pose) return without_pose;
    return pose->source == slam::PoseSource::kMarkers ? io::FrameStatus::kTracking
                                                      : io::FrameStatus::kBridging;
  };
  std::vector<io::FramePose> poses;
  poses.reserve(frames_.size());
  for (std::size_t i = 0; i < frames_.size(); ++i) {
    poses.push_back({frames_[i].monotonic_ns, forgotten_ + i, statusOf(found[i].pose),
                     found[i].pose, slam::describe(found[i].reason)});
  }
  return poses;
}

std::vector<io::RecordedFrame> RunRecord::recordedFrames() const {
  std::vector<io::RecordedFrame> recorded;
  recorded.reserve(frames_.size());
  for (const slam::LiveFrame& frame : frames_)
    recorded.push_back({frame.monotonic_ns, frame.detections});
  return recorded;
}

std::vector<std::int64_t> RunRecord::loopClosedAt_ns(const slam::Counters& counters) const {
  std::vector<std::int64_t> all = loop_closed_at_ns_;
  // What was under way at the last frame is finished after it.
  if (!frames_.empty() && all.size() < counters.loop_closures) {
    all.resize(counters.loop_closures, frames_.back().monotonic_ns);
  }
  return all;
}

std::string RunRecord::statistics(const slam::Slam& slam, const StageTimer& timer,
                                  std::uint64_t dropped_late, const std::string& incomplete,
                                  const diagnosis::Verdict& verdict) const {
  const slam::Counters& counters = slam.counters();
  const Json none = nullptr;
  Json json;
  if (!incomplete.empty()) json["incomplete"] = incomplete;
  json["frames"] = frames();
  if (forgotten_ > 0) json["frames_forgotten"] = forgotten_;
  json["localized"] = localized_;
  json["initialized_at_frame"] = initialized_at_ ? Json(*initialized_at_) : none;
  json["keyframes"] = keyframesOf(slam);
  json["markers"] = posedMarkers(slam);
  json["pieces"] = slam.pieces().size();
  json["loop_closures"] = counters.loop_closures;
  json["loop_closed_at_s"] = Json::array();
  for (const std::int64_t time_ns : loopClosedAt_ns(counters)) {
    json["loop_closed_at_s"].push_back(1e-9 * static_cast<double>(time_ns));
  }
  json["relocalizations"] = counters.relocalizations;
  json["reprojection_rms_px"] = by_markers_ > 0 ? Json(reprojectionRms_px()) : none;
  json["verdict"] = {{"grade", diagnosis::gradeName(verdict.grade)},
                     {"text", verdict.text},
                     {"advice", verdict.advice}};
  json["lens"] = lensOf(slam, lens_learned_at_ns_);
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
