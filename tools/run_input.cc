#include "tools/run_input.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <filesystem>
#include <string>
#include <utility>
#include <variant>

#include "capture/open_source.h"
#include "capture/silence_limit.h"
#include "io/recorded_detections.h"

namespace waymark::tools {
namespace {

using std::chrono_literals::operator""ms;

class FrameInput final : public RunInput {
 public:
  // rate_hz: as asked for; 0: the source's own.
  FrameInput(std::unique_ptr<capture::FrameSource> source, double rate_hz)
      : source_(std::move(source)),
        silence_(std::max(capture::silenceLimit(rate_hz, 0.0, {}),
                          capture::silenceLimit(source_->info().rate_hz, 0.0, {}))) {}

  [[nodiscard]] Result<std::optional<Step>> step(slam::Slam& slam, StageTimer& timer,
                                                 LateResults* late) override {
    auto last_frame = std::chrono::steady_clock::now();
    for (;;) {
      capture::ReadResult read = source_->read(100ms);
      if (Error* error = std::get_if<Error>(&read)) return std::move(*error);
      if (std::holds_alternative<capture::EndOfStream>(read)) return std::optional<Step>{};
      if (std::holds_alternative<capture::TimedOut>(read)) {
        if (!endless() || std::chrono::steady_clock::now() - last_frame < silence_) continue;
        return Error{description() + ": no frame for " + std::to_string(silence_.count()) + " ms"};
      }
      const capture::FramePtr frame = std::get<capture::FramePtr>(std::move(read));
      const capture::FrameStamp& stamp = frame->stamp();
      if (!first_ns_) first_ns_ = source_->info().live ? stamp.monotonic_ns : 0;
      // The SLAM's times are those of the results: at the end both are asked which frame is which.
      const std::int64_t time_ns = stamp.monotonic_ns - *first_ns_;
      slam::FrameInput input{.time = {stamp.sequence, time_ns}, .image = frame->image()};
      if (late != nullptr) input = late->prepare(input, slam);
      timer.beginFrame();
      const slam::FrameResult result = slam.process(input, &timer);
      timer.endFrame();
      if (late != nullptr) late->look(input, result, slam);
      if (observer_) observer_(frame->image());
      return std::optional<Step>({time_ns, result});
    }
  }

  void setImageObserver(const ImageObserver& observer) override { observer_ = observer; }
  [[nodiscard]] const std::string& description() const override {
    return source_->info().description;
  }
  [[nodiscard]] bool unorderedImages() const override { return source_->info().photographs; }
  [[nodiscard]] std::string damage() const override { return source_->damage(); }
  [[nodiscard]] bool endless() const override {
    return source_->info().live && source_->info().frame_count < 0;
  }
  [[nodiscard]] std::optional<std::int64_t> frameCount() const override {
    const std::int64_t count = source_->info().frame_count;
    return count >= 0 ? std::optional(count) : std::nullopt;
  }
  [[nodiscard]] std::uint64_t droppedLate() const override {
    return source_->counters().dropped_late;
  }

 private:
  std::unique_ptr<capture::FrameSource> source_;
  std::chrono::milliseconds silence_;  // of a camera, then it has failed
  std::optional<std::int64_t> first_ns_;
  ImageObserver observer_;
};

class DetectionsInput final : public RunInput {
 public:
  DetectionsInput(const std::string& name, io::RecordedDetections recorded)
      : recorded_(std::move(recorded)),
        description_(name + ", " + std::to_string(recorded_.frames.size()) +
                     " frames of recorded detections") {}

  [[nodiscard]] bool hasImages() const override { return false; }

  [[nodiscard]] Result<std::optional<Step>> step(slam::Slam& slam, StageTimer& timer,
                                                 LateResults* /*late*/) override {
    if (next_ == recorded_.frames.size()) return std::optional<Step>{};
    const io::RecordedFrame& frame = recorded_.frames[next_];
    timer.beginFrame();
    const slam::FrameResult result =
        slam.process({.time = {next_, frame.time_ns}, .detections = frame.detections}, &timer);
    timer.endFrame();
    ++next_;
    return std::optional<Step>({frame.time_ns, result});
  }

  [[nodiscard]] const std::string& description() const override { return description_; }
  [[nodiscard]] std::optional<std::int64_t> frameCount() const override {
    return static_cast<std::int64_t>(recorded_.frames.size());
  }
  [[nodiscard]] std::uint64_t droppedLate() const override { return 0; }

 private:
  io::RecordedDetections recorded_;
  std::string description_;
  std::size_t next_ = 0;
};

slam::Calibration guessed(int width, int height, const RunInputOptions& options) {
  return slam::guessedCamera(width, height, options.fov_deg, {}).calibration();
}

// Nobody says how large the images were that corners were found in.
Result<slam::Calibration> guessedFor(const io::ImageExtent& corners,
                                     const RunInputOptions& options) {
  // Of more and more pixels.
  constexpr std::array<std::pair<int, int>, 18> kUsual = {{{320, 240},
                                                           {640, 480},
                                                           {752, 480},
                                                           {800, 600},
                                                           {848, 480},
                                                           {1280, 720},
                                                           {1024, 1024},
                                                           {1280, 960},
                                                           {1280, 1024},
                                                           {1440, 1080},
                                                           {1600, 1200},
                                                           {1920, 1080},
                                                           {1920, 1200},
                                                           {2048, 1536},
                                                           {2048, 2048},
                                                           {2448, 2048},
                                                           {2592, 1944},
                                                           {3840, 2160}}};
  const auto size = std::ranges::find_if(kUsual, [&](const auto& usual) {
    return corners.right_px < usual.first && corners.bottom_px < usual.second;
  });
  if (size == kUsual.end()) {
    return Error{options.source +
                 ": --calibration: needed, as the images' size is none of the "
                 "usual ones"};
  }
  return guessed(size->first, size->second, options);
}

Result<OpenedInput> openDetections(const RunInputOptions& options,
                                   const std::optional<slam::Calibration>& given) {
  if (options.fps || options.realtime) {
    return Error{options.source + ": --fps and --realtime are for frames, not for detections"};
  }
  if (options.calibration_fit != slam::CalibrationFit::kExact) {
    return Error{options.source + ": --calibration-fit is for frames, not for detections"};
  }
  Result<slam::Calibration> calibration = given ? Result<slam::Calibration>(*given) : Error{};
  if (!given) {
    const Result<io::ImageExtent> extent = io::readImageExtent(options.source);
    if (!extent) return extent.error();
    calibration = guessedFor(*extent, options);
    if (!calibration) return calibration.error();
  }
  Result<io::RecordedDetections> recorded =
      io::readRecordedDetections(options.source, slam::CameraModel(*calibration));
  if (!recorded) return recorded.error();
  return OpenedInput{std::make_unique<DetectionsInput>(options.source, std::move(recorded).value()),
                     {*calibration, ""},
                     given.has_value()};
}

}  // namespace

Result<OpenedInput> openRunInput(const RunInputOptions& options,
                                 const std::optional<slam::Calibration>& calibration) {
  if (std::filesystem::path(options.source).extension() == ".csv") {
    return openDetections(options, calibration);
  }
  capture::SourceOptions source_options{.fps = options.fps, .realtime = options.realtime};
  if (calibration) {
    source_options.camera.width = calibration->width;
    source_options.camera.height = calibration->height;
  }
  Result<std::unique_ptr<capture::FrameSource>> source =
      capture::openSource(options.source, source_options);
  if (!source) return source.error();
  const capture::StreamInfo& info = (*source)->info();
  const double rate_hz = options.fps.value_or(0.0);
  if (!calibration) {
    const slam::Calibration guess = guessed(info.width, info.height, options);
    return OpenedInput{
        std::make_unique<FrameInput>(std::move(source).value(), rate_hz), {guess, ""}, false};
  }
  const Result<slam::FittedCalibration> fitted =
      slam::fitCalibration(*calibration, info.width, info.height, options.calibration_fit);
  if (!fitted) {
    return Error{options.source + " and " + options.calibration + ": " + fitted.error().message};
  }
  return OpenedInput{std::make_unique<FrameInput>(std::move(source).value(), rate_hz), *fitted};
}

}  // namespace waymark::tools
