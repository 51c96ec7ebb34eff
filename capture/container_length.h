// Is a video file as long as its container says? A cut-off copy decodes without complaint up to the
// cut, so this has to be asked for.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>

namespace waymark::capture {

struct ContainerLength {
  std::uint64_t declared_bytes = 0;  // where the container's outermost elements end
  std::uint64_t file_bytes = 0;
  // AVI and MP4 store the number of frames; others only a duration, from which it is estimated.
  bool counts_frames = false;

  [[nodiscard]] bool truncated() const { return file_bytes < declared_bytes; }
};

// Reads AVI (RIFF), MP4/MOV and Matroska/WebM; empty for any other file, and for recordings whose
// writer never came to fill in the length.
[[nodiscard]] std::optional<ContainerLength> containerLength(const std::filesystem::path& path);

}  // namespace waymark::capture
