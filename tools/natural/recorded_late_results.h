// What the daemon's thread found while a recording was made, given to the SLAM with the same frames
// again: so the poses are the same, without the pictures and without looking for them.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <span>
#include <vector>

#include "base/result.h"
#include "slam/late_result.h"
#include "tools/natural/late_results.h"

namespace waymark::tools {

class RecordedLateResults final : public LateResults {
 public:
  // With one frame.
  struct Recorded {
    bool searched = false;
    std::vector<slam::LateResult> late;
  };

  explicit RecordedLateResults(std::map<std::uint64_t, Recorded> by_sequence)
      : by_sequence_(std::move(by_sequence)) {}

  // Of an event log, on through its later files, whatever the channel. What is damaged is not
  // there, as of images. The error names the file and the reason.
  [[nodiscard]] static Result<std::map<std::uint64_t, Recorded>> read(
      const std::filesystem::path& log);

  [[nodiscard]] slam::FrameInput prepare(slam::FrameInput frame, const slam::Slam& slam) override;
  void look(const slam::FrameInput& /*frame*/, const slam::FrameResult& /*result*/,
            const slam::Slam& /*slam*/) override {}

 private:
  const std::map<std::uint64_t, Recorded> by_sequence_;
};

// A waymark.natural_detections_t: which frame it is of, and what it says. Empty when the bytes are
// no whole message of this kind.
struct DecodedNaturalDetections {
  std::uint64_t sequence = 0;
  RecordedLateResults::Recorded recorded;
};
[[nodiscard]] std::optional<DecodedNaturalDetections> decodeNaturalDetections(
    std::span<const std::uint8_t> bytes);

}  // namespace waymark::tools
