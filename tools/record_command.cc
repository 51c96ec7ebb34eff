#include "tools/record_command.h"

#include <cstdint>
#include <cstdio>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

#include <CLI/CLI.hpp>

#include "base/clock.h"
#include "capture/libcamera/libcamera_source.h"
#include "capture/open_source.h"
#include "daemon/configuration.h"
#include "daemon/control/stop_signal.h"
#include "daemon/frames/camera_status.h"
#include "daemon/frames/capture_loop.h"
#include "daemon/record/recorder.h"
#include "daemon/record/recorder_setup.h"
#include "daemon/system/log.h"
#include "io/calibrations/calibration_file.h"
#include "io/text/number_text.h"
#include "io/text/text_file.h"
#include "tools/exit_code.h"
#include "tools/number_arguments.h"
#include "tools/progress_bar.h"

namespace waymark::tools {
namespace {

using capture::RecordedFile;

struct RecordArguments {
  std::string source;
  std::string calibration;
  std::string config;
  std::optional<double> fps;
  std::optional<double> duration_s;
  int width = 0;
  int height = 0;
  std::string format;
  double exposure_s = 0.0;
  daemon::Configuration::Record record;
  bool quiet = false;
};

capture::SourceOptions sourceOptions(const RecordArguments& arguments,
                                     const std::optional<slam::Calibration>& calibration) {
  capture::SourceOptions options{.fps = arguments.fps, .realtime = true};
  options.camera.width = arguments.width;
  options.camera.height = arguments.height;
  if (arguments.width == 0 && calibration) {
    options.camera.width = calibration->width;
    options.camera.height = calibration->height;
  }
  options.camera.format = arguments.format;
  options.camera.exposure_s = arguments.exposure_s;
  options.camera.keep_jpeg = true;
  return options;
}

// What `waymark run` needs beside the images, as far as it is known.
Result<std::vector<RecordedFile>> recordedFiles(
    const RecordArguments& arguments, const std::optional<slam::Calibration>& calibration) {
  std::vector<RecordedFile> files;
  if (calibration) {
    files.push_back(
        {RecordedFile::kCalibration, arguments.calibration, io::formatCalibration(*calibration)});
  }
  if (!arguments.config.empty()) {
    Result<std::string> text = io::readTextFile(arguments.config);
    if (!text) return text.error();
    files.push_back({RecordedFile::kConfiguration, arguments.config, std::move(text).value()});
  }
  return files;
}

// Counters by name.
std::map<std::string, std::uint64_t> countersOf(const daemon::Recorder& recorder) {
  std::map<std::string, std::uint64_t> all;
  recorder.reportCounters([&](const char* name, std::uint64_t value) { all[name] = value; });
  return all;
}

std::uint64_t framesLost(const std::map<std::string, std::uint64_t>& counters) {
  return counters.at("recorder.lost_frames") + counters.at("recorder.lost_paused");
}

std::string describe(const daemon::Recorder& recorder) {
  const auto counters = countersOf(recorder);
  const daemon::Recorder::Report report = recorder.report();
  std::string text =
      io::fixed(static_cast<double>(counters.at("recorder.bytes")) / (1U << 20U), 1) + " MiB";
  const std::uint64_t lost = framesLost(counters);
  if (lost > 0) text += ", " + std::to_string(lost) + " frames lost";
  if (report.state == daemon::RecorderState::kPaused) text += "; paused: " + report.reason;
  return text;
}

// Lets go of every frame, as there is no SLAM to take it, until the camera is stopped.
void drain(daemon::FrameQueue& frames, const RecordArguments& arguments,
           const daemon::StopSignal& stop, const daemon::Recorder& recorder,
           daemon::CaptureLoop* camera) {
  ProgressBar bar(std::nullopt, !arguments.quiet);
  std::optional<std::int64_t> end_ns;
  std::int64_t count = 0;
  while (!frames.finished()) {
    const bool came = frames.pop() != nullptr;
    if (came && !end_ns && arguments.duration_s) {
      end_ns = monotonicNs() + static_cast<std::int64_t>(1e9 * *arguments.duration_s);
    }
    if (stop.pending() || (end_ns && monotonicNs() >= *end_ns)) camera->requestStop();
    bar.update(count += came ? 1 : 0, [&] { return describe(recorder); });
  }
}

Result<ExitCode> record(const RecordArguments& arguments) {
  std::optional<slam::Calibration> calibration;
  if (!arguments.calibration.empty()) {
    const Result<slam::Calibration> read = io::readCalibration(arguments.calibration);
    if (!read) return read.error();
    calibration = *read;
  }
  const Result<std::vector<RecordedFile>> files = recordedFiles(arguments, calibration);
  if (!files) return files.error();
  const Result<capture::Opener> opener =
      capture::sourceOpener(arguments.source, sourceOptions(arguments, calibration));
  if (!opener) return opener.error();
  const Result<io::OutputDirectory> writable =
      io::OutputDirectory::open(arguments.record.directory);
  if (!writable) return writable.error();

  daemon::StopSignal stop;
  daemon::Log log(arguments.quiet ? daemon::LogLevel::kError : daemon::LogLevel::kInfo,
                  /*for_journal=*/false, "waymark");
  const capture::LibcameraMessages libcamera_messages(
      [&log](std::string_view line) { log.warning("libcamera: " + std::string(line)); });
  log.writeBehind();
  daemon::FrameQueue frames(1);
  daemon::CameraStatus status;
  daemon::Recorder recorder(daemon::recorderOptions(arguments.record), *files, log);
  // What is not there now is an error; what fails later comes back.
  Result<std::unique_ptr<capture::FrameSource>> first = (*opener)();
  if (!first) return first.error();
  daemon::CaptureLoop camera({.open = [&]() -> Result<std::unique_ptr<capture::FrameSource>> {
                                return *first ? std::move(*first) : (*opener)();
                              },
                              .comes_back = capture::isCamera(arguments.source),
                              .device_came = capture::monitorHotplug(arguments.source),
                              .rate_hz = arguments.fps.value_or(0.0),
                              .exposure_s = arguments.exposure_s},
                             frames, status, log);
  camera.setTap([&](const capture::Frame& frame) { recorder.addFrame(frame); });

  std::thread recorder_thread([&] { recorder.run(); });
  std::thread camera_thread([&] { camera.run(); });
  // Also while there are no frames, somebody looks at the clock and for signals.
  std::jthread waker([&](const std::stop_token& token) {
    while (!token.stop_requested()) {
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
      frames.wake();
    }
  });
  drain(frames, arguments, stop, recorder, &camera);
  camera_thread.join();
  recorder.requestStop();
  recorder_thread.join();

  if (camera.failure() && status.counters().frames == 0) return *camera.failure();
  log.drain();  // what it says comes before what follows
  const auto counters = countersOf(recorder);
  if (!arguments.quiet) {
    std::printf("%llu frames of %llu in %s: %s\n",
                static_cast<unsigned long long>(counters.at("recorder.events")),
                static_cast<unsigned long long>(status.counters().frames),
                arguments.record.directory.c_str(), describe(recorder).c_str());
  }
  if (camera.failure()) {
    std::fprintf(stderr, "waymark: %s; the frames before it are recorded\n",
                 camera.failure()->message.c_str());
    return kIncomplete;
  }
  if (framesLost(counters) > 0) {
    std::fprintf(stderr, "waymark: the recording is incomplete: %s\n", describe(recorder).c_str());
    return kIncomplete;
  }
  return kDone;
}

}  // namespace

void addRecordCommand(CLI::App& app, int* exit_code) {
  CLI::App* command = app.add_subcommand(
      "record", "Record a camera into event logs, until interrupted; without SLAM");
  const auto arguments = std::make_shared<RecordArguments>();
  command
      ->add_option("source", arguments->source,
                   "A camera (v4l2:/dev/video0, libcamera:0), or a recording, played in real time")
      ->required();
  command->add_option("--out", arguments->record.directory, "Directory for the logs")->required();
  command->add_option("--calibration", arguments->calibration,
                      "The camera's calibration; recorded, too, and says which size to ask for");
  command->add_option("--config", arguments->config,
                      "Configuration file whose section [slam] `waymark run` shall use; recorded");
  command->add_option("--fps", arguments->fps, "Frames a second")->check(frameRate());
  command->add_option("--duration", arguments->duration_s, "Seconds, from the first frame")
      ->check(duration());
  CLI::Option* width = command->add_option("--width", arguments->width, "Pixels")->check(count());
  CLI::Option* height =
      command->add_option("--height", arguments->height, "Pixels")->check(count());
  width->needs(height);
  height->needs(width);
  command->add_option("--format", arguments->format, "GREY, YUYV, MJPG, ...");
  command->add_option("--exposure", arguments->exposure_s, "Fixed exposure time, seconds")
      ->check(positiveNumber());
  command
      ->add_option("--jpeg-quality", arguments->record.jpeg_quality,
                   "Compress grey images with this quality, 1 to 100")
      ->check(wholeNumberFrom(1, 100));
  command
      ->add_option("--file-mib", arguments->record.file_mib,
                   "MiB of a file, then the next one begins")
      ->check(wholeNumberFrom(1, 1'000'000));
  command
      ->add_option("--quota-mib", arguments->record.quota_mib,
                   "MiB of all recordings in the directory; the oldest give way")
      ->check(wholeNumberFrom(1, 100'000'000));
  command
      ->add_option("--keep-free-mib", arguments->record.keep_free_mib,
                   "MiB of the disk, left to others")
      ->check(wholeNumberFrom(0, 100'000'000));
  command->add_flag("--quiet", arguments->quiet, "Say nothing but errors");
  command->callback([arguments, exit_code] {
    const Result<ExitCode> result = record(*arguments);
    if (!result) std::fprintf(stderr, "waymark: %s\n", result.error().message.c_str());
    *exit_code = result ? *result : kBadInput;
  });
}

}  // namespace waymark::tools
