#include "simulator/recording.h"

#include <algorithm>
#include <cstdio>
#include <memory>
#include <string>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/videoio.hpp>

#include "io/text/text_file.h"
#include "io/trajectory.h"
#include "simulator/natural_files.h"
#include "simulator/simulation_json.h"
#include "simulator/truth_files.h"

namespace waymark::simulator {
namespace {

namespace fs = std::filesystem;

// Where the frames go, under a temporary name until keep() gives them their own.
class FrameSink {
 public:
  FrameSink() = default;
  FrameSink(const FrameSink&) = delete;
  FrameSink& operator=(const FrameSink&) = delete;
  virtual ~FrameSink() = default;

  [[nodiscard]] virtual Status write(std::int64_t frame, const cv::Mat& grey) = 0;
  [[nodiscard]] virtual Status keep() = 0;
};

Status renameTo(const fs::path& from, const fs::path& to) {
  std::error_code failed;
  fs::rename(from, to, failed);
  if (failed) return Error{to.string() + ": cannot write: " + failed.message()};
  return success();
}

// FFV1 keeps grey as it is: recording_test.cc reads every pixel back.
class VideoSink : public FrameSink {
 public:
  VideoSink(const fs::path& directory, const Scene& scene)
      : path_(directory / "frames.avi"), partial_(directory / "frames.partial.avi") {
    writer_.open(partial_.string(), cv::CAP_FFMPEG, cv::VideoWriter::fourcc('F', 'F', 'V', '1'),
                 scene.rate_hz, {scene.camera.width, scene.camera.height}, false);
  }
  ~VideoSink() override {
    writer_.release();
    std::error_code ignored;
    fs::remove(partial_, ignored);
  }

  Status write(std::int64_t /*frame*/, const cv::Mat& grey) override {
    if (!writer_.isOpened()) return Error{path_.string() + ": cannot write a video here"};
    writer_.write(grey);
    return success();
  }

  Status keep() override {
    writer_.release();
    return renameTo(partial_, path_);
  }

 private:
  fs::path path_;
  fs::path partial_;
  cv::VideoWriter writer_;
};

class ImageSink : public FrameSink {
 public:
  ImageSink(const fs::path& directory, const Simulation& simulation)
      : simulation_(simulation),
        path_(directory / "frames"),
        partial_(directory / "frames.partial") {
    std::error_code ignored;  // the first write() says what is wrong
    fs::create_directory(partial_, ignored);
  }
  ~ImageSink() override {
    std::error_code ignored;
    fs::remove_all(partial_, ignored);
  }

  Status write(std::int64_t frame, const cv::Mat& grey) override {
    char text[64];
    std::snprintf(text, sizeof text, "%06lld.png", static_cast<long long>(frame));
    const fs::path file = partial_ / text;
    constexpr int kFast = 1;  // compression level: little is gained by more
    if (!cv::imwrite(file.string(), grey, {cv::IMWRITE_PNG_COMPRESSION, kFast})) {
      return Error{(path_ / text).string() + ": cannot write"};
    }
    std::snprintf(text, sizeof text, "%06lld.png %.9f\n", static_cast<long long>(frame),
                  simulation_.timeOf(frame));
    times_ += text;
    return success();
  }

  Status keep() override {
    if (Status status = io::writeTextFile(partial_ / "frames.txt", times_); !status) return status;
    return renameTo(partial_, path_);
  }

 private:
  const Simulation& simulation_;
  fs::path path_;
  fs::path partial_;
  std::string times_;
};

// The output directory; a new one is removed again unless kept.
class Directory {
 public:
  explicit Directory(fs::path path) : path_(std::move(path)) {}
  Directory(const Directory&) = delete;
  Directory& operator=(const Directory&) = delete;
  ~Directory() {
    std::error_code ignored;
    if (made_ && !kept_) fs::remove(path_, ignored);
  }

  Status open() {
    std::error_code failed;
    made_ = fs::create_directories(path_, failed);
    if (failed) return Error{path_.string() + ": cannot make directory: " + failed.message()};
    if (!fs::is_directory(path_)) return Error{path_.string() + ": is not a directory"};
    // A long rendering should not find out at its end that nothing can be written.
    const fs::path probe = path_ / ".writable";
    Status status = io::writeTextFile(probe, "");
    fs::remove(probe, failed);
    if (!status) return Error{path_.string() + ": directory cannot be written"};
    return success();
  }
  void keep() { kept_ = true; }

 private:
  fs::path path_;
  bool made_ = false;
  bool kept_ = false;
};

// Renders some frames at a time, side by side, and hands them on in order.
Status writeFrames(const Simulation& simulation, const RecordingOptions& options, FrameSink* sink) {
  const auto batch = static_cast<std::size_t>(std::max(1, options.threads));
  std::vector<Simulation::Workspace> workspaces(batch);
  std::vector<cv::Mat> images(batch);
  for (cv::Mat& image : images) {
    image.create(simulation.camera().height, simulation.camera().width, CV_8U);
  }
  for (std::int64_t first = 0; first < simulation.frameCount();) {
    const auto count =
        std::min<std::size_t>(batch, static_cast<std::size_t>(simulation.frameCount() - first));
    {
      std::vector<std::jthread> workers;
      for (std::size_t i = 0; i < count; ++i) {
        workers.emplace_back([&, i] {
          simulation.render(first + static_cast<std::int64_t>(i), &workspaces[i], images[i].data);
        });
      }
    }
    for (std::size_t i = 0; i < count; ++i) {
      Status status = sink->write(first + static_cast<std::int64_t>(i), images[i]);
      if (!status) return status;
    }
    first += static_cast<std::int64_t>(count);
    if (options.progress) options.progress(first);
  }
  return success();
}

constexpr const char* kTruthFiles[] = {"calib.yml", "gt_traj.txt", "gt_map.json", "gt_visible.csv",
                                       "simulation.json"};

void removeTruth(const Simulation& simulation, const fs::path& directory) {
  std::error_code ignored;
  removeNatural(directory, simulation.scene());
  for (const char* name : kTruthFiles) fs::remove(directory / name, ignored);
}

Status writeTruth(const Simulation& simulation, const fs::path& directory) {
  Status status = writeStaticTruth(directory, simulation);
  if (status) status = io::writeTrajectory(directory / "gt_traj.txt", trueTrajectory(simulation));
  if (status) {
    status = io::writeTextFile(directory / "gt_visible.csv",
                               io::formatVisibleMarkers(trueVisibility(simulation)));
  }
  if (status) status = io::writeTextFile(directory / "simulation.json", optionsText(simulation));
  if (status) status = writeNatural(directory, simulation.scene());
  if (!status) removeTruth(simulation, directory);
  return status;
}

}  // namespace

Status record(const Simulation& simulation, const RecordingOptions& options) {
  Directory directory(options.directory);
  if (Status status = directory.open(); !status) return status;
  if (options.images && fs::exists(options.directory / "frames")) {
    return Error{(options.directory / "frames").string() + ": exists already"};
  }
  std::unique_ptr<FrameSink> sink;
  if (options.images) {
    sink = std::make_unique<ImageSink>(options.directory, simulation);
  } else {
    sink = std::make_unique<VideoSink>(options.directory, simulation.scene());
  }
  Status status = writeFrames(simulation, options, sink.get());
  if (status) status = writeTruth(simulation, options.directory);
  if (status) {
    status = sink->keep();
    if (!status) removeTruth(simulation, options.directory);
  }
  sink.reset();
  if (status) directory.keep();
  return status;
}

Status recordTruth(const Simulation& simulation, const fs::path& path) {
  Directory directory(path);
  if (Status status = directory.open(); !status) return status;
  Status status = writeTruth(simulation, path);
  if (status) directory.keep();
  return status;
}

}  // namespace waymark::simulator
