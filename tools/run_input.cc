#include "tools/run_input.h"

#include <chrono>
#include <filesystem>
#include <utility>
#include <variant>

#include "base/image_view.h"
#include "capture/open_source.h"
#include "io/recorded_detections.h"

namespace waymark::tools {
namespace {

using std::chrono_literals::operator""ms;

class FrameInput final : public RunInput {
 public:
  explicit FrameInput(std::unique_ptr<capture::FrameSource> source) : source_(std::move(source)) {}

  [[nodiscard]] Result<std::optional<Step>> step(slam::Slam& slam, StageTimer& timer) override {
    for (;;) {
      capture::ReadResult read = source_->read(100ms);
      if (Error* error = std::get_if<Error>(&read)) return std::move(*error);
      if (std::holds_alternative<capture::EndOfStream>(read)) return std::optional<Step>{};
      if (std::holds_alternative<capture::TimedOut>(read)) continue;
      const capture::FramePtr frame = std::get<capture::FramePtr>(std::move(read));
      const capture::FrameStamp& stamp = frame->stamp();
      if (!first_ns_) first_ns_ = source_->info().live ? stamp.monotonic_ns : 0;
      timer.beginFrame();
      const slam::FrameResult result =
          slam.processFrame(frame->image(), {stamp.sequence, stamp.monotonic_ns}, &timer);
      timer.endFrame();
      return std::optional<Step>({stamp.monotonic_ns - *first_ns_, result});
    }
  }

  [[nodiscard]] const std::string& description() const override {
    return source_->info().description;
  }
  [[nodiscard]] bool photographs() const override { return source_->info().photographs; }
  [[nodiscard]] std::optional<std::int64_t> frameCount() const override {
    const std::int64_t count = source_->info().frame_count;
    return count >= 0 ? std::optional(count) : std::nullopt;
  }
  [[nodiscard]] std::uint64_t droppedLate() const override {
    return source_->counters().dropped_late;
  }

 private:
  std::unique_ptr<capture::FrameSource> source_;
  std::optional<std::int64_t> first_ns_;
};

class DetectionsInput final : public RunInput {
 public:
  DetectionsInput(const std::string& name, io::RecordedDetections recorded)
      : recorded_(std::move(recorded)),
        description_(name + ", " + std::to_string(recorded_.frames.size()) +
                     " frames of recorded detections") {}

  [[nodiscard]] Result<std::optional<Step>> step(slam::Slam& slam, StageTimer& timer) override {
    if (next_ == recorded_.frames.size()) return std::optional<Step>{};
    const io::RecordedFrame& frame = recorded_.frames[next_];
    timer.beginFrame();
    const slam::FrameResult result =
        slam.processDetections(frame.detections, {next_, frame.time_ns}, &timer);
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

}  // namespace

Result<std::unique_ptr<RunInput>> openRunInput(const RunInputOptions& options,
                                               const slam::CameraModel& camera) {
  if (std::filesystem::path(options.source).extension() == ".csv") {
    if (options.fps || options.realtime) {
      return Error{options.source + ": --fps and --realtime are for frames, not for detections"};
    }
    Result<io::RecordedDetections> recorded = io::readRecordedDetections(options.source, camera);
    if (!recorded) return recorded.error();
    return std::unique_ptr<RunInput>(
        std::make_unique<DetectionsInput>(options.source, std::move(recorded).value()));
  }
  Result<std::unique_ptr<capture::FrameSource>> source =
      capture::openSource(options.source, {.fps = options.fps, .realtime = options.realtime});
  if (!source) return source.error();
  const capture::StreamInfo& info = (*source)->info();
  if (info.width != camera.width() || info.height != camera.height()) {
    return Error{options.source + ": frames are " + sizeText(info.width, info.height) + ", but " +
                 options.calibration + " is for " + sizeText(camera.width(), camera.height())};
  }
  return std::unique_ptr<RunInput>(std::make_unique<FrameInput>(std::move(source).value()));
}

}  // namespace waymark::tools
