// A simulated sequence on disk: frames without loss, and the truth beside them.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>

#include "base/result.h"
#include "simulator/simulation.h"

namespace waymark::simulator {

struct RecordingOptions {
  std::filesystem::path directory;  // made where it does not exist
  bool images = false;  // frames/000000.png and on, with frames.txt, instead of frames.avi (FFV1)
  int threads = 2;      // that render
  // Told after every few frames; may be empty.
  std::function<void(std::int64_t frames_done)> progress;
};

// Writes the frames, calib.yml, gt_traj.txt, gt_map.json, gt_visible.csv and simulation.json (the
// options used); of scenes that have them the natural markers and targets (natural_files.h). On
// failure it leaves behind nothing of what it wrote; the Error names the file and the reason.
[[nodiscard]] Status record(const Simulation& simulation, const RecordingOptions& options);

// The same without the frames: the truth alone, in moments.
[[nodiscard]] Status recordTruth(const Simulation& simulation,
                                 const std::filesystem::path& directory);

}  // namespace waymark::simulator
