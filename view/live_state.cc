#include "view/live_state.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "daemon/health/health_json.h"
#include "daemon/health/status_name.h"
#include "io/calibrations/calibration_file.h"
#include "slam/detection/codes/dictionary.h"

namespace waymark::view {
namespace {

using io::Json;

// A daemon says something every second.
constexpr std::int64_t kGone_ns = 3'000'000'000;
constexpr std::int64_t kHistogram_ns = 30'000'000'000;
constexpr std::size_t kWay = 32;          // points of the trail that come with each pose
constexpr std::size_t kTrail = 20'000;    // points; then every second one goes
constexpr std::size_t kSeenFrames = 256;  // a preview comes within a second
constexpr std::size_t kMostCounters = 1000;
constexpr std::size_t kMostPictures = 1000;

// Text from the network need not be UTF-8.
std::string dump(const Json& json) {
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

const char* sourceName(std::int8_t source) {
  switch (source) {
    case pose_t::SOURCE_MARKERS:
      return "markers";
    case pose_t::SOURCE_NATURAL_FEATURES:
      return "natural features";
    case pose_t::SOURCE_PREDICTION:
      return "prediction";
    default:
      return "none";
  }
}

const char* stateName(std::int8_t state) {
  return state == marker_t::STATE_UNDECIDED ? "undecided" : "mapped";
}

const char* unposedName(std::int8_t state) {
  switch (state) {
    case unposed_marker_t::STATE_QUARANTINED:
      return "quarantined";
    case unposed_marker_t::STATE_REFUSED:
      return "refused";
    case unposed_marker_t::STATE_ELSEWHERE:
      return "elsewhere";
    default:
      return "unresolved";
  }
}

double worstSigma(const double (&covariance)[36], std::size_t first) {
  return std::sqrt(std::max(
      {0.0, covariance[7 * first], covariance[7 * (first + 1)], covariance[7 * (first + 2)]}));
}

Json naturalJson(const natural_marker_t& m) {
  return {{"id", m.id},           {"name", m.name},
          {"width", m.width},     {"height", pictureHeight(m)},
          {"p", m.p_w_m},         {"q", m.q_w_m},
          {"piece", m.map_piece}, {"sigma_m", worstSigma(m.covariance, 0)}};
}

// The cells of the code, row after row, '1' is white.
std::string cellsOf(const std::optional<slam::Dictionary>& dictionary, std::int32_t id) {
  std::string cells;
  if (!dictionary || id < 0 || id >= dictionary->size()) return cells;
  for (int row = 1; row <= dictionary->side(); ++row) {
    for (int column = 1; column <= dictionary->side(); ++column) {
      cells += dictionary->white(id, row, column) ? '1' : '0';
    }
  }
  return cells;
}

}  // namespace

void LiveState::tick(std::int64_t now_ns) {
  const bool alive = heard_ns_ != 0 && now_ns - heard_ns_ < kGone_ns;
  if (alive != alive_) changed(Part::kLink);
  alive_ = alive;
  if (calibration_ && now_ns - calibrated_ns_ >= kGone_ns) {
    calibration_.reset();
    changed(Part::kCalibration);
  }
  if (now_ns - histogram_since_ns_ > kHistogram_ns) {
    latencies_[1] = std::exchange(latencies_[0], {});
    histogram_since_ns_ = now_ns;
  }
}

void LiveState::setFault(const std::string& fault) {
  if (fault == fault_) return;
  fault_ = fault;
  changed(Part::kLink);
}

void LiveState::setControl(Json status) {
  if (status == control_) return;
  control_ = std::move(status);
  changed(Part::kControl);
}

void LiveState::setPlayback(Json playback) {
  if (playback == playback_) return;
  playback_ = std::move(playback);
  changed(Part::kPlayback);
}

// Another daemon, or the same one started anew.
void LiveState::forgetSession() {
  trail_.clear();
  map_.clear();
  natural_map_.clear();
  latencies_ = {};
  seen_.clear();
  found_.clear();
  preview_.reset();
  body_.reset();
  counters_before_.clear();
  poses_ = missing_ = 0;
  changed(Part::kMap);
  changed(Part::kDetections);
  changed(Part::kPreview);
  changed(Part::kLink);
}

void LiveState::add(const pose_t& pose, std::int64_t now_ns) {
  heard_ns_ = now_ns;
  const bool of_a_frame = pose.status != pose_t::STATUS_NO_CAMERA;
  if (of_a_frame && pose_ && pose.sequence < pose_->sequence) forgetSession();
  if (of_a_frame) {
    if (pose_ && poses_ > 0 && pose.sequence > pose_->sequence + 1) {
      missing_ += static_cast<std::uint64_t>(pose.sequence - pose_->sequence - 1);
    }
    ++poses_;
    const double latency_ms = 1e-6 * static_cast<double>(pose.latency_ns);
    const auto bucket = std::ranges::lower_bound(kLatencyBounds_ms, latency_ms);
    ++latencies_[0][static_cast<std::size_t>(bucket - kLatencyBounds_ms.begin())];
  }
  pose_ = pose;
  addToTrail(pose);
  changed(Part::kPose);
}

void LiveState::addToTrail(const pose_t& pose) {
  const bool finite = std::isfinite(pose.p_w_c[0] + pose.p_w_c[1] + pose.p_w_c[2]);
  if (pose.source == pose_t::SOURCE_NONE || !finite) return;
  TrailPoint point{{static_cast<float>(pose.p_w_c[0]), static_cast<float>(pose.p_w_c[1]),
                    static_cast<float>(pose.p_w_c[2])},
                   pose.sequence,
                   pose.source,
                   trail_.empty() || pose.sequence - trail_sequence_ > 30};
  trail_sequence_ = pose.sequence;
  if (pose.map_piece != trail_piece_) {
    trail_.clear();  // another world
    point.begins = true;
  }
  trail_piece_ = pose.map_piece;
  if (!trail_.empty()) {
    const auto& last = trail_.back().p;
    const float moved =
        std::hypot(point.p[0] - last[0], point.p[1] - last[1], point.p[2] - last[2]);
    constexpr float kStep_m = 0.005F;  // a camera that stands still is one point
    if (moved < kStep_m && !point.begins) return;
  }
  trail_.push_back(point);
  if (trail_.size() < kTrail) return;
  std::size_t kept = 0;
  for (std::size_t i = 0; i < trail_.size(); i += 2) trail_[kept++] = trail_[i];
  trail_.resize(kept);
}

template <typename Message>
io::PartAdded LiveState::addPart(const Message& part, std::int64_t now_ns,
                                 io::MapParts<Message>* map) {
  heard_ns_ = now_ns;
  const io::PartAdded added = map->add(part);
  if (added == io::PartAdded::kImpossible) addMalformed();
  if (added == io::PartAdded::kWhole) changed(Part::kMap);
  return added;
}

void LiveState::add(const map_t& part, std::int64_t now_ns) {
  const bool is_known = addPart(part, now_ns, &map_) == io::PartAdded::kKnown;
  // Natural markers come right after each revision: where it comes again and they have not, there
  // are none any more.
  if (is_known && !natural_map_.whole().empty() && natural_map_.revision() != map_.revision()) {
    natural_map_.clear();
    changed(Part::kMap);
  }
}

void LiveState::add(const natural_map_t& part, std::int64_t now_ns) {
  (void)addPart(part, now_ns, &natural_map_);
}

void LiveState::add(const health_t& health, std::int64_t now_ns) {
  heard_ns_ = now_ns;
  if (health.counters.size() > kMostCounters) return addMalformed();
  if (health_ && health.uptime_ns < health_->uptime_ns) forgetSession();
  health_ = health;
  if (counters_before_.empty()) {
    for (const counter_t& counter : health.counters) counters_before_[counter.name] = counter.value;
  }
  changed(Part::kHealth);
}

void LiveState::add(const detections_t& detections, std::int64_t now_ns) {
  heard_ns_ = now_ns;
  SeenFrame& frame = seen_.emplace_back();
  frame.detections = detections;
  if (pose_ && pose_->sequence == detections.sequence) frame.pose = pose_;
  if (seen_.size() > kSeenFrames) seen_.pop_front();
  changed(Part::kDetections);
}

// Each tells of earlier frames; of every picture the newest is kept.
void LiveState::add(const natural_detections_t& found, std::int64_t now_ns) {
  heard_ns_ = now_ns;
  if (found.detections.size() > kMostPictures) return addMalformed();
  for (const natural_detection_t& picture : found.detections) {
    if (found_.size() >= kMostPictures) found_.clear();
    found_[picture.id] = {picture, found.monotonic_ns};
    // The image of that frame may be there already.
    if (preview_ && preview_->sequence == picture.sequence) changed(Part::kPreview);
  }
}

void LiveState::add(const preview_t& preview, std::int64_t now_ns) {
  heard_ns_ = now_ns;
  if (!isPlausible(preview)) return addMalformed();
  preview_ = preview;
  changed(Part::kPreview);
}

void LiveState::add(const calibration_t& calibration, std::int64_t now_ns) {
  heard_ns_ = now_ns;
  if (!isPlausible(calibration)) return addMalformed();
  calibration_ = calibration;
  calibrated_ns_ = now_ns;
  changed(Part::kCalibration);
}

// Its pose is a part of the frame's.
void LiveState::add(const bot_core::pose_t& body, std::int64_t now_ns) {
  heard_ns_ = now_ns;
  body_ = body;
  changed(Part::kPose);
}

Json LiveState::link() const {
  return {{"type", "link"}, {"alive", alive_}, {"fault", fault_}, {"malformed", malformed_}};
}

Json LiveState::endOfTrail(std::size_t most) const {
  const auto rounded = [](float m) { return 1e-4 * std::round(1e4 * static_cast<double>(m)); };
  Json points = Json::array();
  for (std::size_t i = trail_.size() - std::min(trail_.size(), most); i < trail_.size(); ++i) {
    const TrailPoint& point = trail_[i];
    points.push_back({point.sequence, rounded(point.p[0]), rounded(point.p[1]), rounded(point.p[2]),
                      point.source, point.begins ? 1 : 0});
  }
  return points;
}

Json LiveState::pose() const {
  Json json = {{"type", "pose"}};
  if (!pose_) return json;
  const pose_t& m = *pose_;
  json["sequence"] = m.sequence;
  json["utime"] = m.utime;
  json["status"] = daemon::statusName(m.status);
  json["reason"] = m.reason;
  json["source"] = sourceName(m.source);
  json["piece"] = m.map_piece;
  json["had_pose"] = m.had_pose != 0;
  json["last_pose_age_s"] = 1e-9 * static_cast<double>(m.last_pose_age_ns);
  if (m.source != pose_t::SOURCE_NONE) {
    json["p"] = m.p_w_c;
    json["q"] = m.q_w_c;
    json["way"] = endOfTrail(kWay);
    json["markers"] = m.markers_used;
    json["rms_px"] = m.reprojection_rms_px;
    json["sigma_m"] = worstSigma(m.covariance, 0);
    json["sigma_rad"] = worstSigma(m.covariance, 3);
    json["ambiguity"] = m.ambiguity_ratio;
  }
  if (body_ && body_->utime == m.utime) {
    json["body"] = {{"p", body_->pos}, {"q", body_->orientation}};
  }
  json["latency_ms"] = 1e-6 * static_cast<double>(m.latency_ns);
  json["frames"] = poses_;
  json["missing"] = missing_;
  Json histogram = Json::array();
  for (std::size_t i = 0; i < latencies_[0].size(); ++i) {
    histogram.push_back(latencies_[0][i] + latencies_[1][i]);
  }
  json["latency_histogram"] = {{"bounds_ms", kLatencyBounds_ms}, {"counts", histogram}};
  return json;
}

Json LiveState::map() const {
  Json json = {{"type", "map"},
               {"markers", Json::array()},
               {"natural", Json::array()},
               {"unposed", Json::array()}};
  for (const auto& [number, part] : natural_map_.whole()) {
    for (const natural_marker_t& m : part.markers) json["natural"].push_back(naturalJson(m));
  }
  if (map_.whole().empty()) return json;
  const map_t& first = map_.whole().begin()->second;
  const auto dictionary = slam::Dictionary::byName(first.dictionary);
  json["revision"] = first.revision;
  json["dictionary"] = first.dictionary;
  json["side"] = dictionary ? dictionary->side() : 0;
  json["keyframes"] = first.keyframe_count;
  for (const auto& [number, part] : map_.whole()) {
    for (const marker_t& m : part.markers) {
      json["markers"].push_back({{"id", m.id},
                                 {"size", m.size},
                                 {"p", m.p_w_m},
                                 {"q", m.q_w_m},
                                 {"state", stateName(m.state)},
                                 {"views", m.views},
                                 {"piece", m.map_piece},
                                 {"sigma_m", m.sigma_m},
                                 {"cells", cellsOf(dictionary, m.id)}});
    }
    for (const unposed_marker_t& m : part.unposed) {
      json["unposed"].push_back(
          {{"id", m.id}, {"size", m.size}, {"state", unposedName(m.state)}, {"views", m.views}});
    }
  }
  return json;
}

Json LiveState::health() const {
  Json json = {{"type", "health"}};
  if (!health_) return json;
  json.update(daemon::healthJson(*health_));
  Json& grown = json["grown"] = Json::object();  // since we listen
  for (const counter_t& counter : health_->counters) {
    const auto before = counters_before_.find(counter.name);
    const std::int64_t at_first = before == counters_before_.end() ? 0 : before->second;
    if (counter.value > at_first) grown[counter.name] = counter.value - at_first;
  }
  return json;
}

void LiveState::tellSeen(const SeenFrame& frame, Json* json) const {
  const pose_t* const pose = frame.pose ? &*frame.pose : nullptr;
  const lens_t* const lens = health_ ? &health_->lens : nullptr;
  (*json)["markers"] = seenMarkers(frame.detections, pose, lens, map_.whole());
  (*json)["pictures"] = seenPictures(frame.detections, pose, lens, natural_map_.whole(), found_);
}

Json LiveState::detections() const {
  Json json = {{"type", "detections"}, {"markers", Json::array()}, {"pictures", Json::array()}};
  if (seen_.empty()) return json;
  json["sequence"] = seen_.back().detections.sequence;
  json["seen"] = seen_.back().detections.seen;
  tellSeen(seen_.back(), &json);
  return json;
}

// With what was found in the same frame.
Json LiveState::preview() const {
  if (!preview_) return {{"type", "preview"}};
  Json json = previewJson(*preview_);
  const auto frame = std::ranges::find_if(
      seen_, [&](const SeenFrame& seen) { return seen.detections.sequence == preview_->sequence; });
  if (frame != seen_.end()) tellSeen(*frame, &json);
  if (calibration_ && calibration_->sequence == preview_->sequence) {
    json["board"] = boardJson(*calibration_);
  }
  return json;
}

Json LiveState::calibration() const {
  Json json = {{"type", "calibration"}};
  if (!calibration_) return json;
  const calibration_t& m = *calibration_;
  json["advice"] = m.advice;
  json["enough"] = m.enough != 0;
  json["frames"] = m.frames;
  json["frames_with_board"] = m.frames_with_board;
  json["views"] = m.views;
  json["covered"] = coveredShare(m);
  return json;
}

Json LiveState::part(Part which) const {
  switch (which) {
    case Part::kLink:
      return link();
    case Part::kPose:
      return pose();
    case Part::kMap:
      return map();
    case Part::kHealth:
      return health();
    case Part::kDetections:
      return detections();
    case Part::kPreview:
      return preview();
    case Part::kControl:
      return {{"type", "control"}, {"status", control_}};
    case Part::kPlayback:
      return playback_.is_null() ? Json{{"type", "playback"}} : playback_;
    case Part::kCalibration:
      return calibration();
  }
  return {};
}

std::string LiveState::text(Part which) const { return dump(part(which)); }

std::string LiveState::trailText() const {
  return dump({{"type", "trail"}, {"points", endOfTrail(trail_.size())}});
}

std::optional<std::string> LiveState::calibrationFile() const {
  const auto lens = health_ ? calibrationOf(health_->lens) : std::nullopt;
  return lens ? std::optional(io::formatCalibration(*lens)) : std::nullopt;
}

std::string LiveState::stateText() const {
  return dump({{"link", link()},
               {"pose", pose()},
               {"map", map()},
               {"health", health()},
               {"detections", detections()},
               {"calibration", calibration()}}) +
         "\n";
}

}  // namespace waymark::view
