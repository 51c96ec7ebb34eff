// What waymarkd is told to do: a TOML file, checked key by key before anything starts.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "base/result.h"
#include "capture/camera_options.h"
#include "daemon/publish/body_motion.h"
#include "daemon/system/log.h"
#include "daemon/system/realtime.h"
#include "io/settings/settings_file.h"
#include "io/settings/slam_settings.h"
#include "slam/geometry/calibration_fit.h"

namespace waymark::daemon {

// Sections nest as in the file; waymarkd.toml explains every key.
struct Configuration {
  struct Simulator {
    std::uint64_t seed = 1;
    int width = 640;                  // pixels
    int height = 480;                 // pixels
    double loop_s = 4.0;              // seconds rendered in advance, then played round and round
    std::filesystem::path truth_dir;  // where to write the exact truth; empty: nowhere
  };

  struct Camera {
    std::string source;                 // a camera, "sim:SCENE", or a recording's path
    std::filesystem::path calibration;  // the simulator has its own
    slam::CalibrationFit calibration_fit = slam::CalibrationFit::kExact;
    double rate_hz = 0.0;           // 0: the source's own
    capture::CameraOptions device;  // of cameras; their rate is rate_hz
    Simulator simulator;
  };

  // [[natural]]: a picture whose print is known.
  struct NaturalMarker {
    std::string name;
    std::filesystem::path image;
    double width_m = 0.0;
    double height_m = 0.0;  // 0: from the image's shape
    slam::Transform T_w_m;  // where both of these are given:
    bool has_position = false;
    bool has_orientation = false;
  };

  // The thread that looks for them.
  struct Relocalizer {
    std::filesystem::path markers;  // a file of natural markers, instead of [[natural]]
    double core_share = 0.5;
  };

  struct Queue {
    int depth = 4;  // frames
  };

  struct RealTime {
    ThreadOptions capture;
    ThreadOptions slam;
    ThreadOptions publisher;
    ThreadOptions recorder;
    bool lock_memory = false;
  };

  struct Publish {
    std::string url = "udpm://239.255.76.67:7667?ttl=0";
    std::string channel_prefix = "WAYMARK_";
    std::string pose_channel = "POSE";
    bool detections = true;
    double map_interval_s = 5.0;  // also of a map that does not change: subscribers come late
  };

  // Into LCM event logs; recorder.h.
  struct Record {
    std::filesystem::path directory;  // empty: there is no recorder
    bool at_start = true;             // else when somebody asks for it
    bool images = true;               // else only what is published
    int jpeg_quality = 0;             // 1 to 100, for grey images; 0: as they are
    std::string image_channel = "CAMERA";
    int file_mib = 2048;      // MiB; then the next file begins
    int file_s = 600;         // seconds; likewise
    int quota_mib = 0;        // MiB of all recordings; the oldest give way. 0: no limit
    int keep_free_mib = 500;  // MiB of the disk, left to others
    int flush_ms = 1000;      // milliseconds that a power cut may cost
    int buffer_mib = 64;      // MiB of frames that wait for the disk
  };

  // The Unix socket for `waymark ctl`.
  struct Control {
    std::filesystem::path socket;  // empty: control.sock in the service's runtime directory, if any
  };

  struct Logging {
    LogLevel level = LogLevel::kInfo;
  };

  Camera camera;
  BodyMotion::Options body;  // T_b_c
  io::SlamSettings slam;
  std::vector<NaturalMarker> natural;
  Relocalizer relocalizer;
  Queue queue;
  RealTime realtime;
  Publish publish;
  Record record;
  Control control;
  Logging log;
  std::string text;  // all of it, as it stands in the file
};

// There is no calibration: the lens is learned from the markers.
[[nodiscard]] bool lensIsUnknown(const Configuration& configuration);

// Relative paths in the file count from the file's own directory. Syntax errors, unknown keys,
// wrong types and impossible values are errors: "FILE:LINE:COLUMN: KEY: reason".
[[nodiscard]] Result<Configuration> readConfiguration(const std::filesystem::path& file);

// The same from text; `file` names it in errors and anchors relative paths.
[[nodiscard]] Result<Configuration> parseConfiguration(const std::string& text,
                                                       const std::filesystem::path& file);

// Every key there is; `target` must outlive them.
[[nodiscard]] std::vector<io::Setting> configurationKeys(Configuration& target);

}  // namespace waymark::daemon
