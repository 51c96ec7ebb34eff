#include "daemon/health/health_journal.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <string_view>
#include <utility>

#include "daemon/health/status_name.h"

namespace waymark::daemon {
namespace {

// Counters that count what should not happen.
bool isFault(std::string_view counter) {
  constexpr std::array<std::string_view, 8> kPrefixes = {
      "dropped.",      "deadline.",     "unsent.",         "camera.silences",
      "map.save_fail", "recorder.lost", "recorder.pauses", "slam.frames_in_other_world"};
  return std::ranges::any_of(kPrefixes, [&](auto prefix) { return counter.starts_with(prefix); });
}

}  // namespace

HealthJournal::Changes HealthJournal::changes(const health_t& health) {
  Changes changes;
  std::string state = describeState(health);
  if (state != reported_state_ && health.monotonic_ns >= next_state_ns_) {
    changes.state = state;
    reported_state_ = std::move(state);
    next_state_ns_ = health.monotonic_ns + options_.state_pause_ns;
  }
  if (health.monotonic_ns >= next_lens_ns_) {
    changes.lens = changedLens(health.lens);
    if (!changes.lens.empty()) next_lens_ns_ = health.monotonic_ns + options_.state_pause_ns;
  }
  if (health.monotonic_ns >= next_faults_ns_) {
    changes.faults = grownFaults(health);
    if (!changes.faults.empty()) next_faults_ns_ = health.monotonic_ns + options_.faults_pause_ns;
  }
  return changes;
}

std::string HealthJournal::describeState(const health_t& health) {
  std::string text = statusName(health.status);
  if (!health.reason.empty()) text += ": " + health.reason;
  if (health.map_piece_count > 1) {
    text += "; in piece " + std::to_string(health.map_piece) + " of a map of " +
            std::to_string(health.map_piece_count) + " pieces";
  }
  return text;
}

std::string HealthJournal::changedLens(const lens_t& lens) {
  const double was_px = std::exchange(reported_focal_px_, lens.fx);
  // Fewer than before: another map was begun or loaded, and its lens is told as given.
  if (lens.changes <= std::exchange(reported_lens_changes_, lens.changes)) return {};
  std::array<char, 32> before{};
  if (was_px > 0.0) std::snprintf(before.data(), before.size(), " (%.2f before)", was_px);
  std::array<char, 200> text{};
  std::snprintf(
      text.data(), text.size(),
      "the markers tell another lens: focal length %.2f px%s, known to %.2g %%; corners fit "
      "to %.2f px (%.2f before)",
      lens.fx, before.data(), 100.0 * lens.focal_sigma, lens.rms_after_px, lens.rms_before_px);
  return text.data();
}

std::string HealthJournal::grownFaults(const health_t& health) {
  std::string text;
  for (const counter_t& counter : health.counters) {
    if (!isFault(counter.name)) continue;
    std::int64_t& reported = reported_faults_[counter.name];
    if (counter.value > reported) {
      text += (text.empty() ? "" : ", ") + counter.name + " +" +
              std::to_string(counter.value - reported) + " (" + std::to_string(counter.value) + ")";
    }
    reported = counter.value;
  }
  return text;
}

}  // namespace waymark::daemon
