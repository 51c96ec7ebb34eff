#include "daemon/frames/slam_loop.h"

#include <algorithm>

#include "base/clock.h"

namespace waymark::daemon {

SlamLoop::SlamLoop(std::unique_ptr<slam::Slam> slam, FrameQueue& frames, const CameraStatus& camera,
                   SlamRequests& requests, SlamOutput& output, const Options& options)
    : slam_(std::move(slam)),
      frames_(frames),
      camera_(camera),
      requests_(requests),
      output_(output),
      options_(options) {
  output_.alive_ns.store(monotonicNs(), std::memory_order_relaxed);
  const auto& markers = slam_->map().markers();
  const auto posed = std::ranges::count_if(
      markers, [](const auto& id_and_marker) { return id_and_marker.second.T_w_m.has_value(); });
  reportMapSize(static_cast<std::size_t>(posed));
  map_changed_ = posed > 0;  // subscribers have not heard of it
}

void SlamLoop::run() {
  while (!frames_.finished()) {
    const capture::FramePtr frame = frames_.pop();
    output_.alive_ns.store(monotonicNs(), std::memory_order_relaxed);
    if (requests_.pending()) serveRequest();
    if (frame) process(*frame);
  }
  requests_.close();
  if (map_changed_) handOnMap(last_stamp_);
  output_.finished.store(true, std::memory_order_release);
}

// The counters of a SLAM that is replaced stay, so that those in health only grow; and subscribers
// learn of the other map at once.
void SlamLoop::serveRequest() {
  const slam::Slam* const before = slam_.get();
  const slam::Counters counted = counters();
  requests_.serve(slam_);
  if (slam_.get() == before) return;
  earlier_ = counted;
  countMapChange();
  handOnMap(last_stamp_);
  next_map_ns_ = 0;
}

slam::Counters SlamLoop::counters() const { return earlier_ + slam_->counters(); }

void SlamLoop::countMapChange() {
  map_changed_ = true;
  output_.map_revision.fetch_add(1, std::memory_order_relaxed);
}

void SlamLoop::process(const capture::Frame& frame) {
  const capture::FrameStamp& stamp = frame.stamp();
  output_.frame_began_ns.store(monotonicNs(), std::memory_order_relaxed);
  clock_.beginFrame();
  const slam::FrameResult result = slam_->process(
      {.time = {stamp.sequence, stamp.monotonic_ns}, .image = frame.image()}, &clock_);
  record(stamp, result, clock_.endFrame());
  output_.frame_began_ns.store(0, std::memory_order_relaxed);
  if (!output_.records.try_enqueue(record_)) {
    output_.records_lost.fetch_add(1, std::memory_order_relaxed);
  }
  if (result.map_changed) countMapChange();
  handOnMapWhenDue(stamp);
  last_stamp_ = stamp;
}

void SlamLoop::record(const capture::FrameStamp& stamp, const slam::FrameResult& result,
                      std::int64_t processing_ns) {
  record_.stamp = stamp;
  record_.state = result.state;
  record_.reason = result.reason;
  record_.pose = result.pose;
  record_.processing_ns = processing_ns;
  record_.missed_deadline_in.reset();
  if (tookTooLong(processing_ns)) record_.missed_deadline_in = clock_.longest();
  record_.counters = counters();
  record_.seen = static_cast<int>(result.detections.size());
  const std::size_t kept = std::min(result.detections.size(), record_.markers.size());
  for (std::size_t i = 0; i < kept; ++i) {
    const slam::MarkerDetection& detection = result.detections[i];
    record_.markers[i] = {detection.id, detection.hamming, detection.pixels};
  }
}

bool SlamLoop::tookTooLong(std::int64_t processing_ns) const {
  const double said_hz = camera_.rateHz();
  const double rate_hz = said_hz > 0.0 ? said_hz : options_.usual_rate_hz;
  return static_cast<double>(processing_ns) * rate_hz > 1e9;
}

void SlamLoop::handOnMapWhenDue(const capture::FrameStamp& stamp) {
  if (!map_changed_ || stamp.monotonic_ns < next_map_ns_) return;
  handOnMap(stamp);
  next_map_ns_ = stamp.monotonic_ns + options_.map_interval_ns;
}

void SlamLoop::handOnMap(const capture::FrameStamp& stamp) {
  const slam::Map& map = slam_->map();
  MapSnapshot& snapshot = output_.map.writeBuffer();
  snapshot.stamp = stamp;
  snapshot.keyframe_count = static_cast<int>(map.keyframes().size());
  snapshot.markers.clear();
  for (const auto& [id, marker] : map.markers()) {
    if (!marker.T_w_m) continue;
    snapshot.markers.push_back({id, marker.size_m, *marker.T_w_m, marker.world_covariance});
  }
  reportMapSize(snapshot.markers.size());
  output_.map.publish();
  map_changed_ = false;
}

void SlamLoop::reportMapSize(std::size_t posed_markers) {
  output_.map_markers.store(static_cast<int>(posed_markers), std::memory_order_relaxed);
  output_.map_keyframes.store(static_cast<int>(slam_->map().keyframes().size()),
                              std::memory_order_relaxed);
}

}  // namespace waymark::daemon
