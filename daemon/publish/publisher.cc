#include "daemon/publish/publisher.h"

#include <cmath>
#include <numeric>
#include <span>
#include <string>
#include <utility>

#include "base/clock.h"
#include "daemon/health/temperatures.h"

namespace waymark::daemon {
namespace {

// How often the publisher looks up from an empty queue, and so the delay of news about the camera.
constexpr std::int64_t kPatienceUs = 20'000;
constexpr std::int64_t kHealthIntervalNs = 1'000'000'000;
constexpr std::int64_t kHealthPauseNs = 50'000'000;  // when the status flickers
constexpr std::int64_t kNoCameraIntervalNs = 1'000'000'000;

std::int8_t cameraState(CameraState state) {
  switch (state) {
    case CameraState::kOpening:
      return health_t::CAMERA_OPENING;
    case CameraState::kRunning:
      return health_t::CAMERA_RUNNING;
    case CameraState::kLost:
      return health_t::CAMERA_LOST;
    case CameraState::kEnded:
      return health_t::CAMERA_ENDED;
  }
  return health_t::CAMERA_OPENING;
}

}  // namespace

Publisher::Publisher(const Configuration::Publish& options, const BodyMotion::Options& body,
                     std::string dictionary, SlamOutput& input, const CameraStatus& camera,
                     const FrameQueue& frames, TripleBuffer<health_t>& health, const Log& log)
    : options_(options),
      detections_wanted_(options.detections),
      dictionary_(std::move(dictionary)),
      pose_channel_(options.channel_prefix + "POSE"),
      detections_channel_(options.channel_prefix + "DETECTIONS"),
      map_channel_(options.channel_prefix + "MAP"),
      health_channel_(options.channel_prefix + "HEALTH"),
      natural_detections_channel_(options.channel_prefix + "NATURAL"),
      natural_map_channel_(options.channel_prefix + "NATURAL_MAP"),
      joint_channel_(options.channel_prefix + "JOINT"),
      input_(input),
      camera_(camera),
      frames_(frames),
      health_out_(health),
      link_(options.url, log),
      started_ns_(monotonicNs()),
      body_(body) {
  health_.version = WAYMARK_VERSION;
}

void Publisher::run() {
  for (bool more = true; more;) {
    // Asked before looking, so that what came in between is not left behind.
    const bool finished = input_.finished.load(std::memory_order_acquire);
    link_.maintain(monotonicNs());
    if (input_.records.wait_dequeue_timed(record_, finished ? 0 : kPatienceUs)) {
      publishFrame();
    } else {
      more = !finished;
    }
    publishMap(monotonicNs());
    watchCamera(monotonicNs());
    publishHealthWhenDue(monotonicNs());
  }
  publishHealth(monotonicNs());
}

void Publisher::publishFrame() {
  if (record_.pose) last_pose_ns_ = record_.stamp.monotonic_ns;
  if (record_.missed_deadline_in) {
    ++deadlines_missed_[*record_.missed_deadline_in];
  }

  publishJoints();

  const std::int8_t status_before = pose_.status;
  const std::int32_t piece_before = pose_.map_piece;
  fillPose(record_, last_pose_ns_, pose_);
  pose_.latency_ns = monotonicNs() - record_.stamp.monotonic_ns;
  ++(send(pose_channel_, pose_) ? poses_sent_ : poses_unsent_);
  statistics_.add(record_.pose.has_value(), pose_.latency_ns, record_.processing_ns);
  if (pose_.status != status_before || pose_.map_piece != piece_before) health_changed_ = true;

  if (record_.pose) {
    fillBotCorePose(body_.update(*record_.pose, record_.stamp.monotonic_ns), record_.stamp.utime,
                    bot_core_pose_);
    send(options_.pose_channel, bot_core_pose_);
  }
  if (detections()) {
    fillDetections(record_, dictionary_, detections_);
    send(detections_channel_, detections_);
  }
  publishNaturalDetections();
}

// Before the pose whose coordinates are other ones for it.
void Publisher::publishJoints() {
  for (const slam::PieceEvent& event : std::span(record_.events).first(record_.piece_events)) {
    fillJoint(event, record_.stamp, joint_);
    send(joint_channel_, joint_);
    body_.enterWorld(record_.map_piece, event);
    health_changed_ = true;
  }
}

// A recording needs them to give the same poses again, so that nobody can switch them off.
void Publisher::publishNaturalDetections() {
  if (!record_.searched && record_.heard == 0) return;
  fillNaturalDetections(record_, prints_, natural_detections_);
  send(natural_detections_channel_, natural_detections_);
}

// A change at once; what stays as it is again and again, as subscribers may come late.
void Publisher::publishMap(std::int64_t now_ns) {
  if (const MapSnapshot* map = input_.map.take()) {
    newest_map_ = map;  // good until the next one is taken
    ++map_revision_;
  } else if (newest_map_ == nullptr || now_ns < next_map_ns_) {
    return;
  }
  next_map_ns_ = now_ns + std::llround(1e9 * options_.map_interval_s);
  for (int piece = 0; piece < mapPieceCount(*newest_map_); ++piece) {
    fillMapPiece(*newest_map_, dictionary_, map_revision_, piece, map_);
    send(map_channel_, map_);
  }
  if (prints_.empty() && newest_map_->pictures.empty()) return;
  for (int piece = 0; piece < naturalPieceCount(*newest_map_); ++piece) {
    fillNaturalMapPiece(*newest_map_, prints_, map_revision_, piece, natural_map_);
    send(natural_map_channel_, natural_map_);
  }
}

// Subscribers to poses learn at once, and again and again, that and why there are none.
void Publisher::watchCamera(std::int64_t now_ns) {
  if (const std::uint32_t version = camera_.version(); version != camera_version_) {
    camera_version_ = version;
    camera_report_ = camera_.latest();
    health_changed_ = true;
    next_no_camera_ns_ = now_ns;
  }
  const bool absent =
      camera_report_.state == CameraState::kOpening || camera_report_.state == CameraState::kLost;
  if (absent && now_ns >= next_no_camera_ns_) publishNoCamera(now_ns);
}

void Publisher::publishNoCamera(std::int64_t now_ns) {
  fillNoCamera(camera_report_.reason, wallUs(), now_ns, last_pose_ns_, pose_);
  send(pose_channel_, pose_);
  next_no_camera_ns_ = now_ns + kNoCameraIntervalNs;
}

void Publisher::publishHealthWhenDue(std::int64_t now_ns) {
  const std::int64_t since_last_ns = now_ns - health_.monotonic_ns;
  const std::int64_t pause_ns = health_changed_ ? kHealthPauseNs : kHealthIntervalNs;
  if (since_last_ns >= pause_ns) publishHealth(now_ns);
}

void Publisher::publishHealth(std::int64_t now_ns) {
  health_changed_ = false;
  health_.utime = wallUs();
  health_.monotonic_ns = now_ns;
  health_.uptime_ns = now_ns - started_ns_;
  health_.status = pose_.status;
  health_.reason = pose_.reason;
  health_.map_piece = pose_.map_piece;
  health_.map_piece_count = input_.map_pieces.load(std::memory_order_relaxed);
  health_.camera = cameraState(camera_report_.state);
  health_.camera_reason = camera_report_.reason;
  statistics_.report(now_ns, health_);
  fillCounters();
  health_.temperatures = readTemperatures();
  health_.temperature_count = static_cast<std::int32_t>(health_.temperatures.size());
  send(health_channel_, health_);
  health_out_.writeBuffer() = health_;
  health_out_.publish();
}

// Every frame and every reason for which one may get lost, in the order of its way. What the source
// had, camera.frames + dropped.source_*, is what came out, published.poses + dropped.*, once
// nothing is under way any more.
void Publisher::fillCounters() {
  const capture::SourceCounters source = camera_.counters();
  health_.counters.clear();
  for (const capture::NamedSourceCounter& counter : capture::kSourceCounters) {
    addCounter(counter.name, source.*counter.value);
  }
  addCounter("camera.reopened", camera_.reopened());
  addCounter("camera.silences", camera_.silences());
  addCounter("camera.options_refused", camera_.rejected());
  addCounter("dropped.queue", frames_.dropped());
  for (const slam::NamedCounter& counter : slam::kCounters) {
    addCounter(std::string("slam.") + counter.name, record_.counters.*counter.value);
  }
  addCounter("deadline.missed", std::reduce(deadlines_missed_.begin(), deadlines_missed_.end()));
  for (std::size_t stage = 0; stage < deadlines_missed_.size(); ++stage) {
    addCounter(std::string("deadline.missed_") + kFrameStages[stage].name,
               deadlines_missed_[stage]);
  }
  addCounter("dropped.publisher", input_.records_lost.load(std::memory_order_relaxed));
  addCounter("dropped.unsent", poses_unsent_);
  addCounter("published.poses", poses_sent_);
  addCounter("unsent.link_down", unsent_.link_down);
  addCounter("unsent.too_large", unsent_.too_large);
  for (const CounterSource& counters : others_) {
    counters([this](const char* name, std::uint64_t value) { addCounter(name, value); });
  }
  health_.counter_count = static_cast<std::int32_t>(health_.counters.size());
}

void Publisher::addCounter(std::string name, std::uint64_t value) {
  health_.counters.emplace_back();
  health_.counters.back().name = std::move(name);
  health_.counters.back().value = static_cast<std::int64_t>(value);
}

template <typename Message>
bool Publisher::send(const std::string& channel, const Message& message) {
  const int size = message.encode(bytes_.data(), 0, static_cast<int>(bytes_.size()));
  if (size < 0) {
    ++unsent_.too_large;
    return false;
  }
  const auto encoded = std::span<const std::uint8_t>(bytes_).first(static_cast<std::size_t>(size));
  if (tap_) tap_(channel, encoded, wallUs());
  if (!link_.publish(channel, encoded)) {
    ++unsent_.link_down;
    return false;
  }
  return true;
}

}  // namespace waymark::daemon
