#include "daemon/frames/slam_loop.h"

#include <algorithm>
#include <array>

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
  std::array<std::size_t, 2> posed{};  // markers, and natural ones
  for (const auto& [id, marker] : slam_->map().markers()) {
    if (marker.T_w_m) ++posed[slam::isPicture(id) ? 1 : 0];
  }
  reportMapSize(posed[0], posed[1]);
  map_changed_ = posed[0] + posed[1] > 0;  // subscribers have not heard of it
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
  if (relocalizer_ != nullptr) relocalizer_->forget();
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
  slam::FrameInput input{.time = {stamp.sequence, stamp.monotonic_ns}, .image = frame.image()};
  if (relocalizer_ != nullptr) {
    input.late = relocalizer_->hear();
    input.awaited = relocalizer_->idle();
  }
  const slam::FrameResult result = slam_->process(input, &clock_);
  record(stamp, input, result, clock_.endFrame());
  output_.frame_began_ns.store(0, std::memory_order_relaxed);
  if (!output_.records.try_enqueue(record_)) {
    output_.records_lost.fetch_add(1, std::memory_order_relaxed);
  }
  if (result.map_changed) countMapChange();
  if (input.awaited) {
    const std::uint64_t revision = output_.map_revision.load(std::memory_order_relaxed);
    relocalizer_->ask(input, result, slam_->map(), revision);
  }
  handOnMapWhenDue(stamp);
  last_stamp_ = stamp;
}

void SlamLoop::record(const capture::FrameStamp& stamp, const slam::FrameInput& input,
                      const slam::FrameResult& result, std::int64_t processing_ns) {
  record_.stamp = stamp;
  record_.state = result.state;
  record_.reason = result.reason;
  record_.pose = result.pose;
  record_.processing_ns = processing_ns;
  record_.missed_deadline_in.reset();
  if (tookTooLong(processing_ns)) record_.missed_deadline_in = clock_.longest();
  record_.counters = counters();
  record_.searched = input.awaited;
  record_.heard = std::min(input.late.size(), record_.late.size());
  std::copy_n(input.late.begin(), record_.heard, record_.late.begin());
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
  snapshot.pictures.clear();
  snapshot.unposed.clear();
  for (const auto& [id, marker] : map.markers()) {
    const int views = static_cast<int>(map.viewsOf(id).size());
    if (!marker.T_w_m) {
      if (!slam::isPicture(id)) {
        snapshot.unposed.push_back({id, marker.size_m, marker.state, views});
      }
      continue;
    }
    auto& of_its_kind = slam::isPicture(id) ? snapshot.pictures : snapshot.markers;
    of_its_kind.push_back({id, marker.size_m, *marker.T_w_m, marker.world_covariance,
                           marker.other_T_w_m.has_value(), views});
  }
  reportMapSize(snapshot.markers.size(), snapshot.pictures.size());
  output_.map.publish();
  map_changed_ = false;
}

void SlamLoop::reportMapSize(std::size_t markers, std::size_t natural_markers) {
  output_.map_markers.store(static_cast<int>(markers), std::memory_order_relaxed);
  output_.map_natural_markers.store(static_cast<int>(natural_markers), std::memory_order_relaxed);
  output_.map_keyframes.store(static_cast<int>(slam_->map().keyframes().size()),
                              std::memory_order_relaxed);
}

}  // namespace waymark::daemon
