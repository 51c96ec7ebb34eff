#include "capture/libcamera/libcamera_source.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <sstream>
#include <utility>

#include <libcamera/control_ids.h>
#include <libcamera/framebuffer_allocator.h>
#include <libcamera/property_ids.h>
#include <libcamera/request.h>
#include <linux/dma-buf.h>
#include <readerwriterqueue/readerwritercircularbuffer.h>
#include <sys/ioctl.h>
#include <sys/mman.h>

#include "base/clock.h"
#include "base/image_view.h"
#include "base/system_reason.h"
#include "capture/camera_buffers.h"
#include "capture/frame_maker.h"
#include "capture/libcamera/manager.h"
#include "capture/libcamera/settings.h"
#include "capture/mid_exposure.h"
#include "capture/pixel_format.h"
#include "capture/wall_clock.h"

namespace waymark::capture {
namespace {

using std::chrono::microseconds;
using std::chrono::nanoseconds;

constexpr std::size_t kMaxBuffers = 64;

// The first plane of a buffer, as far as grey pictures need it.
struct MappedPlane {
  void* address = MAP_FAILED;
  std::size_t size = 0;    // of the mapping
  std::size_t offset = 0;  // where the plane begins in it
  int fd = -1;             // libcamera's
};

class Mappings {
 public:
  Mappings() = default;
  Mappings(const Mappings&) = delete;
  Mappings& operator=(const Mappings&) = delete;
  ~Mappings() {
    for (const MappedPlane& plane : planes_) munmap(plane.address, plane.size);
  }

  [[nodiscard]] Status add(const libcamera::FrameBuffer& buffer) {
    const libcamera::FrameBuffer::Plane& plane = buffer.planes().front();
    MappedPlane mapped;
    mapped.fd = plane.fd.get();
    mapped.offset =
        plane.offset == libcamera::FrameBuffer::Plane::kInvalidOffset ? 0 : plane.offset;
    mapped.size = mapped.offset + plane.length;
    mapped.address = mmap(nullptr, mapped.size, PROT_READ, MAP_SHARED, mapped.fd, 0);
    if (mapped.address == MAP_FAILED) return Error{"mapping a buffer: " + systemReason()};
    planes_.push_back(mapped);
    return success();
  }

  [[nodiscard]] std::span<const std::uint8_t> bytes(std::size_t index, std::size_t used) const {
    const MappedPlane& plane = planes_[index];
    const auto* begin = static_cast<const std::uint8_t*>(plane.address) + plane.offset;
    return {begin, std::min(used, plane.size - plane.offset)};
  }
  [[nodiscard]] int dmaBuf(std::size_t index) const { return planes_[index].fd; }

  // Caches that do not see the camera's writes are told when we read. Where buffers are no DMABUF,
  // or need no telling, this does nothing.
  void sync(std::size_t index, std::uint64_t when) const {
    dma_buf_sync request{.flags = when | DMA_BUF_SYNC_READ};
    (void)ioctl(planes_[index].fd, DMA_BUF_IOCTL_SYNC, &request);
  }

 private:
  std::vector<MappedPlane> planes_;
};

// A cancelled request is no frame: the camera is being stopped, or has failed.
bool isFrame(const libcamera::Request& request) {
  return request.status() == libcamera::Request::RequestComplete;
}

const libcamera::FrameMetadata& metadataOf(const libcamera::Request& request) {
  return request.buffers().begin()->second->metadata();
}

// One request for each buffer; request i fills buffer i. Those that libcamera has completed wait in
// a queue that its thread fills and ours empties.
class LibcameraSource final : public FrameSource {
 public:
  LibcameraSource(std::shared_ptr<libcamera::CameraManager> manager, libcam::AcquiredCamera camera,
                  const CameraOptions& options)
      : manager_(std::move(manager)),
        camera_(std::move(camera)),
        allocator_(camera_.shared()),
        options_(options) {}
  LibcameraSource(const LibcameraSource&) = delete;
  LibcameraSource& operator=(const LibcameraSource&) = delete;
  ~LibcameraSource() override;

  [[nodiscard]] Status start();

  [[nodiscard]] const StreamInfo& info() const override { return info_; }
  [[nodiscard]] SourceCounters counters() const override { return counters_; }
  [[nodiscard]] ReadResult read(std::chrono::milliseconds timeout) override;

 private:
  [[nodiscard]] Status configure();
  [[nodiscard]] Status allocate();
  void describe(std::vector<std::string> warnings);
  void completed(libcamera::Request* request);  // libcamera's thread
  [[nodiscard]] Error error(const std::string& what, int code) const;
  [[nodiscard]] Status takeBack();
  [[nodiscard]] Status giveBack(std::size_t index);
  [[nodiscard]] microseconds patience(std::int64_t deadline_ns) const;
  [[nodiscard]] libcamera::Request* nextCompleted(microseconds patience);
  void take(const libcamera::Request& request);
  [[nodiscard]] Result<FramePtr> frameOf(libcamera::Request* request);
  [[nodiscard]] FrameStamp stamp(const libcamera::Request& request,
                                 const libcamera::FrameMetadata& metadata);

  const std::shared_ptr<libcamera::CameraManager> manager_;
  libcam::AcquiredCamera camera_;
  libcamera::FrameBufferAllocator allocator_;
  const CameraOptions options_;
  std::unique_ptr<libcamera::CameraConfiguration> configuration_;
  ChosenMode mode_;
  StreamInfo info_;
  Mappings mappings_;
  std::vector<std::unique_ptr<libcamera::Request>> requests_;
  CameraBuffers buffers_;
  bool running_ = false;
  moodycamel::BlockingReaderWriterCircularBuffer<libcamera::Request*> completed_{kMaxBuffers};
  std::atomic<bool> disconnected_{false};
  std::optional<FrameMaker> maker_;
  WallClock wall_clock_;
  SourceCounters counters_;
};

Error LibcameraSource::error(const std::string& what, int code) const {
  return {"libcamera:" + camera_->id() + ": " + what + ": " + systemReason(-code)};
}

LibcameraSource::~LibcameraSource() {
  if (running_) camera_->stop();
  camera_->requestCompleted.disconnect(this);
  camera_->disconnected.disconnect(this);
  requests_.clear();
}

Status LibcameraSource::start() {
  if (Status configured = configure(); !configured) return configured;
  if (Status allocated = allocate(); !allocated) return allocated;
  camera_->requestCompleted.connect(this, &LibcameraSource::completed);
  camera_->disconnected.connect(this, [this] { disconnected_ = true; });

  std::vector<std::string> warnings = mode_.warnings;
  const libcamera::ControlList controls =
      libcam::startControls(*camera_.shared(), options_, &warnings);
  if (const int code = camera_->start(&controls); code != 0) return error("starting", code);
  running_ = true;
  wall_clock_.update();
  // Some pipelines pass over what they are started with, that of uvcvideo among them.
  requests_.front()->controls().merge(controls);
  for (const std::unique_ptr<libcamera::Request>& request : requests_) {
    if (const int code = camera_->queueRequest(request.get()); code != 0) {
      return error("asking for a frame", code);
    }
    buffers_.given();
  }
  describe(std::move(warnings));
  return success();
}

Status LibcameraSource::configure() {
  configuration_ = camera_->generateConfiguration({libcamera::StreamRole::Viewfinder});
  const std::string name = "libcamera:" + camera_->id() + ": ";
  if (!configuration_ || configuration_->empty()) return Error{name + "shows no video"};
  Result<ChosenMode> mode = libcam::applyMode(options_, configuration_.get());
  if (!mode) return Error{name + mode.error().message};
  mode_ = std::move(mode).value();
  if (const int code = camera_->configure(configuration_.get()); code != 0) {
    return error("configuring", code);
  }
  return success();
}

Status LibcameraSource::allocate() {
  const libcamera::StreamConfiguration& configured = configuration_->at(0);
  libcamera::Stream* const stream = configured.stream();
  if (const int code = allocator_.allocate(stream); code < 0) return error("allocating", code);
  const auto& buffers = allocator_.buffers(stream);
  if (buffers.size() > kMaxBuffers) return error("too many buffers", -EINVAL);
  for (std::size_t i = 0; i < buffers.size(); ++i) {
    if (Status mapped = mappings_.add(*buffers[i]); !mapped) return mapped;
    std::unique_ptr<libcamera::Request> request = camera_->createRequest(i);
    if (!request) return error("creating a request", -ENOMEM);
    if (const int code = request->addBuffer(stream, buffers[i].get()); code != 0) {
      return error("giving it a buffer", code);
    }
    requests_.push_back(std::move(request));
  }
  buffers_ = CameraBuffers(static_cast<int>(buffers.size()));
  maker_.emplace(FrameMaker::Format{.layout = findPixelFormat(mode_.fourcc)->layout,
                                    .width = mode_.width,
                                    .height = mode_.height,
                                    .stride = static_cast<std::ptrdiff_t>(configured.stride),
                                    .keep_jpeg = options_.keep_jpeg},
                 static_cast<int>(buffers.size()));
  return success();
}

void LibcameraSource::describe(std::vector<std::string> warnings) {
  info_.width = mode_.width;
  info_.height = mode_.height;
  const bool rate_set = camera_->controls().count(&libcamera::controls::FrameDurationLimits) > 0;
  info_.rate_hz = rate_set ? options_.rate_hz : 0.0;
  info_.live = true;
  std::ostringstream text;
  text << "libcamera:" << camera_->id() << ", " << fourccText(mode_.fourcc) << " "
       << sizeText(mode_.width, mode_.height);
  if (info_.rate_hz > 0.0) text << ", " << info_.rate_hz << " Hz";
  info_.description = text.str();
  for (std::string& warning : warnings) {
    info_.warnings.push_back("libcamera:" + camera_->id() + ": " + std::move(warning));
  }
}

// The queue has room for every request there is.
void LibcameraSource::completed(libcamera::Request* request) {
  (void)completed_.try_enqueue(request);
}

ReadResult LibcameraSource::read(std::chrono::milliseconds timeout) {
  const std::int64_t deadline_ns = monotonicNs() + nanoseconds(timeout).count();
  for (;;) {
    if (disconnected_) return Error{info_.description + ": unplugged"};
    if (const Status back = takeBack(); !back) return back.error();
    if (libcamera::Request* const request = nextCompleted(patience(deadline_ns))) {
      Result<FramePtr> frame = frameOf(request);
      if (!frame) return frame.error();
      if (*frame) return std::move(frame).value();
    }
    if (monotonicNs() >= deadline_ns) return TimedOut{};
  }
}

Status LibcameraSource::takeBack() {
  return buffers_.takeBack([this](int index) { return maker_->shows(index); },
                           [this](int index) { return giveBack(static_cast<std::size_t>(index)); });
}

Status LibcameraSource::giveBack(std::size_t index) {
  mappings_.sync(index, DMA_BUF_SYNC_END);
  requests_[index]->reuse(libcamera::Request::ReuseBuffers);
  if (const int code = camera_->queueRequest(requests_[index].get()); code != 0) {
    return error("asking for a frame", code);
  }
  buffers_.given();
  return success();
}

microseconds LibcameraSource::patience(std::int64_t deadline_ns) const {
  const nanoseconds rest(std::max<std::int64_t>(deadline_ns - monotonicNs(), 0));
  return std::chrono::ceil<microseconds>(buffers_.patience(rest));
}

// Null when none came in time. Of several that wait the newest; the others go back.
libcamera::Request* LibcameraSource::nextCompleted(microseconds patience) {
  libcamera::Request* newest = nullptr;
  buffers_.beginTaking();
  if (!completed_.wait_dequeue_timed(newest, patience)) return nullptr;
  take(*newest);
  for (libcamera::Request* next = nullptr; completed_.try_dequeue(next); newest = next) {
    take(*next);
    if (isFrame(*newest)) ++counters_.dropped_late;
    // A camera that takes nothing back says so when it is asked the next time.
    (void)giveBack(newest->cookie());
  }
  return newest;
}

void LibcameraSource::take(const libcamera::Request& request) {
  buffers_.taken();
  if (isFrame(request)) buffers_.countFrame(metadataOf(request).sequence, &counters_);
}

// Null when it is not good enough to be shown; then it is counted.
Result<FramePtr> LibcameraSource::frameOf(libcamera::Request* request) {
  const std::size_t index = request->cookie();
  const libcamera::FrameMetadata& metadata = metadataOf(*request);
  FramePtr frame;
  mappings_.sync(index, DMA_BUF_SYNC_START);
  const bool taken = isFrame(*request);
  if (taken && metadata.status == libcamera::FrameMetadata::FrameSuccess) {
    frame = maker_->make(static_cast<int>(index),
                         mappings_.bytes(index, metadata.planes().front().bytesused),
                         mappings_.dmaBuf(index), &counters_);
  } else if (taken) {
    ++counters_.dropped_flagged;
  }
  if (frame) {
    frame->setStamp(stamp(*request, metadata));
    ++counters_.frames;
  }
  if (maker_->shows(static_cast<int>(index))) {
    buffers_.show(static_cast<int>(index));
  } else if (Status given = giveBack(index); !given) {
    return given.error();
  }
  return frame;
}

FrameStamp LibcameraSource::stamp(const libcamera::Request& request,
                                  const libcamera::FrameMetadata& metadata) {
  const libcamera::ControlList& said =
      const_cast<libcamera::Request&>(request).metadata();  // not const in libcamera
  const auto exposure_us = said.get(libcamera::controls::ExposureTime);
  const std::int64_t exposure_ns = exposure_us ? 1000 * std::int64_t{*exposure_us} : 0;
  const auto sensor_ns = said.get(libcamera::controls::SensorTimestamp);
  const DriverTime time =
      sensor_ns ? DriverTime{.ns = *sensor_ns, .meaning = DriverTime::Meaning::kStartOfExposure}
                : DriverTime{.ns = static_cast<std::int64_t>(metadata.timestamp),
                             .meaning = DriverTime::Meaning::kEndOfFrame};
  wall_clock_.update();
  const MidExposure mid = midExposure(time, exposure_ns, monotonicNs());
  if (mid.on_arrival) ++counters_.stamped_on_arrival;
  return {.sequence = buffers_.sequence(),
          .monotonic_ns = mid.monotonic_ns,
          .utime = wall_clock_.utime(mid.monotonic_ns),
          .exposure_ns = exposure_ns};
}

}  // namespace

Result<LibcameraOpener> LibcameraOpener::create(const std::string& name,
                                                const CameraOptions& options) {
  libcam::quietUnlessAsked();
  if (name.empty()) return Error{"libcamera:: after libcamera: comes a number or an id"};
  if (!options.format.empty() && !readFourcc(options.format)) {
    return Error{"libcamera:" + name + ": the format '" + options.format +
                 "' cannot be read; there are " + knownFormats()};
  }
  return LibcameraOpener(name, options);
}

Result<std::unique_ptr<FrameSource>> LibcameraOpener::open() {
  Result<std::shared_ptr<libcamera::CameraManager>> manager = libcam::sharedManager();
  if (!manager) return manager.error();
  running_ = *manager;
  Result<std::shared_ptr<libcamera::Camera>> camera =
      libcam::findCamera(**manager, known_id_.empty() ? name_ : known_id_);
  if (!camera) {
    // What was plugged in while libcamera started may be missed for good: it starts anew next time.
    running_.reset();
    return camera.error();
  }
  Result<libcam::AcquiredCamera> acquired = libcam::AcquiredCamera::acquire(*camera);
  if (!acquired) return acquired.error();
  auto source = std::make_unique<LibcameraSource>(*manager, std::move(acquired).value(), options_);
  if (const Status started = source->start(); !started) return started.error();
  known_id_ = (*camera)->id();
  return std::unique_ptr<FrameSource>(std::move(source));
}

std::vector<LibcameraCamera> listLibcameras() {
  libcam::quietUnlessAsked();
  const Result<std::shared_ptr<libcamera::CameraManager>> manager = libcam::sharedManager();
  if (!manager) return {};
  std::vector<LibcameraCamera> all;
  for (const std::shared_ptr<libcamera::Camera>& camera : (*manager)->cameras()) {
    LibcameraCamera listed{
        .id = camera->id(),
        .model = camera->properties().get(libcamera::properties::Model).value_or(std::string()),
        .modes = {},
        .controls = {}};
    const auto configuration = camera->generateConfiguration({libcamera::StreamRole::Viewfinder});
    if (configuration && !configuration->empty()) {
      for (const OfferedMode& mode : libcam::offeredModes(configuration->at(0))) {
        listed.modes.push_back(fourccText(mode.fourcc) + " " + describeSize(mode));
      }
    }
    for (const auto& [id, info] : camera->controls()) {
      listed.controls.push_back(id->name() + ": " + info.toString());
    }
    all.push_back(std::move(listed));
  }
  return all;
}

}  // namespace waymark::capture
