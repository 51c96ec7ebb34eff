#include "capture/v4l2/v4l2_source.h"

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <sstream>
#include <utility>
#include <vector>

#include "base/clock.h"
#include "base/image_view.h"
#include "capture/camera_buffers.h"
#include "capture/frame_maker.h"
#include "capture/mid_exposure.h"
#include "capture/mode_choice.h"
#include "capture/pixel_format.h"
#include "capture/v4l2/controls.h"
#include "capture/v4l2/stream.h"
#include "capture/wall_clock.h"

namespace waymark::capture {
namespace {

using std::chrono::nanoseconds;
using v4l2::Device;
using v4l2::FilledBuffer;
using v4l2::Stream;

class V4l2Source final : public FrameSource {
 public:
  V4l2Source(Device device, const ChosenMode& mode, std::int64_t exposure_ns)
      : device_(std::move(device)), mode_(mode), exposure_ns_(exposure_ns) {}

  [[nodiscard]] Status start(int buffers, bool keep_jpeg);
  void describe(const v4l2::Camera& camera, std::vector<std::string> warnings);

  [[nodiscard]] const StreamInfo& info() const override { return info_; }
  [[nodiscard]] SourceCounters counters() const override { return counters_; }
  [[nodiscard]] ReadResult read(std::chrono::milliseconds timeout) override;

 private:
  [[nodiscard]] Status takeBack();
  [[nodiscard]] Result<std::optional<FilledBuffer>> dequeueNewest();
  [[nodiscard]] nanoseconds patience(std::int64_t deadline_ns) const;
  [[nodiscard]] FrameStamp stamp(const FilledBuffer& filled);
  [[nodiscard]] Result<FramePtr> frameOf(const FilledBuffer& filled);

  Device device_;
  ChosenMode mode_;
  std::int64_t exposure_ns_;  // 0: unknown
  StreamInfo info_;
  std::optional<Stream> stream_;  // refers to device_
  std::optional<FrameMaker> maker_;
  WallClock wall_clock_;
  SourceCounters counters_;
  std::optional<Error> failure_;  // came with the frame that was handed out last
};

Status V4l2Source::start(int buffers, bool keep_jpeg) {
  Result<Stream> stream = Stream::open(device_, mode_, buffers);
  if (!stream) return stream.error();
  stream_.emplace(std::move(stream).value());
  maker_.emplace(FrameMaker::Format{.layout = findPixelFormat(mode_.fourcc)->layout,
                                    .width = mode_.width,
                                    .height = mode_.height,
                                    .stride = stream_->stride(),
                                    .keep_jpeg = keep_jpeg},
                 stream_->buffers().count());
  wall_clock_.update();
  return stream_->start();
}

void V4l2Source::describe(const v4l2::Camera& camera, std::vector<std::string> warnings) {
  info_.width = mode_.width;
  info_.height = mode_.height;
  info_.rate_hz = stream_->rateHz();
  info_.live = true;
  std::ostringstream text;
  text << camera.path << " (" << camera.card.name << ", " << camera.card.bus << "), "
       << fourccText(mode_.fourcc) << " " << sizeText(mode_.width, mode_.height);
  if (info_.rate_hz > 0.0) text << ", " << info_.rate_hz << " Hz";
  info_.description = text.str();
  if (stream_->interlaced()) {
    warnings.push_back("the pictures are interlaced: what moves is torn");
  }
  for (std::string& warning : warnings) {
    info_.warnings.push_back(camera.path + ": " + std::move(warning));
  }
}

ReadResult V4l2Source::read(std::chrono::milliseconds timeout) {
  const std::int64_t deadline_ns = monotonicNs() + nanoseconds(timeout).count();
  if (failure_) return *failure_;
  bool healthy = true;
  for (;;) {
    if (const Status back = takeBack(); !back) return back.error();
    const Result<std::optional<FilledBuffer>> filled = dequeueNewest();
    if (!filled) return filled.error();
    if (*filled) {
      Result<FramePtr> frame = frameOf(**filled);
      if (!frame) return frame.error();
      if (*frame) return std::move(frame).value();
    } else if (!healthy) {
      return Error{info_.description + ": the driver reports an error"};
    }
    if (monotonicNs() >= deadline_ns) return TimedOut{};
    if (!*filled) healthy = stream_->wait(patience(deadline_ns));
  }
}

// Buffers whose frames have been let go return to the driver.
Status V4l2Source::takeBack() {
  return stream_->buffers().takeBack([this](int index) { return maker_->shows(index); },
                                     [this](int index) { return stream_->enqueue(index); });
}

// When several wait, we were late: what is old is not worth showing.
Result<std::optional<FilledBuffer>> V4l2Source::dequeueNewest() {
  std::optional<FilledBuffer> newest;
  stream_->buffers().beginTaking();
  for (;;) {
    const Result<std::optional<FilledBuffer>> next = stream_->dequeue();
    if (!next) return next.error();
    if (!*next) return newest;
    stream_->buffers().countFrame((*next)->sequence, &counters_);
    if (newest) {
      ++counters_.dropped_late;
      if (const Status given = stream_->enqueue(newest->index); !given) return given.error();
    }
    newest = **next;
  }
}

nanoseconds V4l2Source::patience(std::int64_t deadline_ns) const {
  const nanoseconds rest(std::max<std::int64_t>(deadline_ns - monotonicNs(), 0));
  return stream_->buffers().patience(rest);
}

FrameStamp V4l2Source::stamp(const FilledBuffer& filled) {
  wall_clock_.update();
  const MidExposure mid = midExposure(filled.time, exposure_ns_, monotonicNs());
  if (mid.on_arrival) ++counters_.stamped_on_arrival;
  return {.sequence = stream_->buffers().sequence(),
          .monotonic_ns = mid.monotonic_ns,
          .utime = wall_clock_.utime(mid.monotonic_ns),
          .exposure_ns = exposure_ns_};
}

// Null when it is not good enough to be shown; then it is counted.
Result<FramePtr> V4l2Source::frameOf(const FilledBuffer& filled) {
  FramePtr frame;
  if (filled.faulty) {
    ++counters_.dropped_flagged;
  } else {
    frame = maker_->make(filled.index, filled.data, stream_->dmaBuf(filled.index), &counters_);
  }
  if (frame) {
    frame->setStamp(stamp(filled));
    ++counters_.frames;
  }
  if (maker_->shows(filled.index)) {
    stream_->buffers().show(filled.index);
  } else if (const Status given = stream_->enqueue(filled.index); !given) {
    if (!frame) return given.error();
    failure_ = given.error();  // this frame is whole, and counted: the next read tells
  }
  return frame;
}

}  // namespace

Result<V4l2Opener> V4l2Opener::create(const std::string& name, const CameraOptions& options) {
  Result<v4l2::CameraName> parsed = v4l2::parseCameraName(name);
  if (!parsed) return parsed.error();
  if (!options.format.empty() && !readFourcc(options.format)) {
    return Error{"v4l2:" + name + ": the format '" + options.format +
                 "' cannot be read; there are " + knownFormats()};
  }
  return V4l2Opener(std::move(parsed).value(), options);
}

Result<std::unique_ptr<FrameSource>> V4l2Opener::open() {
  const v4l2::CameraList list = v4l2::listCameras();
  const Result<v4l2::Camera> camera = v4l2::findCamera(name_, known_, list.cameras);
  if (!camera) {
    // The one that is meant may be among those that we may not open.
    std::string message = camera.error().message;
    for (const std::string& rejected : list.rejected) message += "; " + rejected;
    return Error{std::move(message)};
  }
  Result<Device> device = Device::open(camera->path);
  if (!device) return device.error();
  const Result<ChosenMode> mode = chooseMode(device->modes(), options_);
  if (!mode) return Error{camera->path + ": " + mode.error().message};

  std::vector<std::string> warnings = mode->warnings;
  std::ranges::move(v4l2::applyControls(*device, options_), std::back_inserter(warnings));
  const std::int64_t exposure_ns = v4l2::exposureNs(*device);
  auto source = std::make_unique<V4l2Source>(std::move(device).value(), *mode, exposure_ns);
  if (const Status started = source->start(options_.buffers, options_.keep_jpeg); !started)
    return started.error();
  source->describe(*camera, std::move(warnings));
  known_ = v4l2::CameraIdentity::of(*camera, list.cameras, known_);
  return std::unique_ptr<FrameSource>(std::move(source));
}

}  // namespace waymark::capture
