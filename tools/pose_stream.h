// What a subscriber to poses can say about the stream as a whole. The health messages beside it
// tell where missing frames were lost.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <waymark/health_t.hpp>
#include <waymark/pose_t.hpp>

namespace waymark::tools {

class PoseStream {
 public:
  // `received_ns`: CLOCK_MONOTONIC when the message was there.
  void add(const pose_t& pose, std::int64_t received_ns);
  void add(const health_t& health);
  void addMalformed() { ++malformed_; }

  [[nodiscard]] std::int64_t messages() const { return messages_; }
  [[nodiscard]] std::int64_t localized() const { return localized_; }
  // Frames that were produced between the first and the last message, but of which none came.
  [[nodiscard]] std::int64_t missing() const { return missing_; }

  // For people, several lines, each beginning with `prefix`.
  [[nodiscard]] std::string summary(const std::string& prefix) const;

 private:
  std::int64_t messages_ = 0;   // of any kind
  std::int64_t frames_ = 0;     // messages that a frame stands behind
  std::int64_t localized_ = 0;  // of those, with a pose
  std::int64_t missing_ = 0;
  std::int64_t restarts_ = 0;  // the sequence went back: the daemon was started anew
  std::int64_t malformed_ = 0;
  // Frames that took the daemon longer than there is between two; likewise.
  std::optional<std::int64_t> deadlines_missed_;
  std::string drops_;  // as the last health message counts them; empty before the first
  std::optional<std::int64_t> last_sequence_;
  std::int64_t first_ns_ = 0, last_ns_ = 0;  // monotonic, mid-exposure
  std::vector<std::int64_t> publish_latency_ns_;
  std::vector<std::int64_t> receive_latency_ns_;
};

}  // namespace waymark::tools
