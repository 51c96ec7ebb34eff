#include "daemon/frames/slam_loop.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "base/clock.h"
#include "daemon/frames/map_snapshot.h"

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
  MapSnapshot begun_with;
  const std::vector<const slam::Map*> pieces = slam_->pieces();
  for (const slam::Map* const piece : pieces) addTo(&begun_with, *piece);
  reportMapSize(begun_with, pieces.size());
  // Subscribers have not heard of it.
  map_changed_ = !begun_with.markers.empty() || !begun_with.pictures.empty();
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
    relocalizer_->ask(input, result, slam_->camera(), slam_->map(), revision);
  }
  handOnMapWhenDue(stamp);
  last_stamp_ = stamp;
  givePreviewWhenDue(input, result);
}

// With the pose handed on already, and only while no other frame waits for its own.
void SlamLoop::givePreviewWhenDue(const slam::FrameInput& input, const slam::FrameResult& result) {
  if (preview_ == nullptr || !input.image || !frames_.empty()) return;
  const std::int64_t now_ns = monotonicNs();
  if (!preview_->wanted(now_ns)) return;
  preview_->give(last_stamp_, *input.image, result.detections, now_ns);
}

void SlamLoop::record(const capture::FrameStamp& stamp, const slam::FrameInput& input,
                      const slam::FrameResult& result, std::int64_t processing_ns) {
  record_.stamp = stamp;
  record_.state = result.state;
  record_.reason = result.reason;
  record_.pose = result.pose;
  record_.map_piece = slam_->map().piece;
  record_.piece_events = std::min(result.piece_events.size(), record_.events.size());
  std::copy_n(result.piece_events.begin(), record_.piece_events, record_.events.begin());
  record_.processing_ns = processing_ns;
  record_.missed_deadline_in.reset();
  if (tookTooLong(processing_ns)) record_.missed_deadline_in = clock_.longest();
  record_.counters = counters();
  recordLens();
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

void SlamLoop::recordLens() {
  const slam::LensKnowledge& known = slam_->lens();
  record_.lens = {.calibration = slam_->camera().calibration(),
                  .state = known.state,
                  .focal_sigma = known.focalShare(),
                  .rms_before_px = known.rms_before_px,
                  .rms_after_px = known.rms_after_px,
                  .changes = known.changes};
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
  MapSnapshot& snapshot = output_.map.writeBuffer();
  snapshot.stamp = stamp;
  const std::vector<const slam::Map*> pieces = slam_->pieces();
  fillSnapshot(pieces, &snapshot);
  reportMapSize(snapshot, pieces.size());
  output_.map.publish();
  map_changed_ = false;
}

void SlamLoop::reportMapSize(const MapSnapshot& snapshot, std::size_t pieces) {
  const auto store = [](std::atomic<int>* to, std::size_t count) {
    to->store(static_cast<int>(count), std::memory_order_relaxed);
  };
  store(&output_.map_markers, snapshot.markers.size());
  store(&output_.map_natural_markers, snapshot.pictures.size());
  output_.map_keyframes.store(snapshot.keyframe_count, std::memory_order_relaxed);
  store(&output_.map_pieces, pieces);
}

}  // namespace waymark::daemon
