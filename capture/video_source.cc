#include "capture/video_source.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <string>
#include <utility>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>
#include <unistd.h>

#include "base/image_view.h"
#include "base/system_reason.h"

namespace waymark::capture {
namespace {

constexpr double kDefaultRate = 30.0;         // Hz, for containers that do not say
constexpr double kLargestRate = 10000.0;      // Hz; more is a container's nonsense
constexpr std::int64_t kTick_ns = 1'000'000;  // times in Matroska are rounded to this

class VideoSource final : public FrameSource {
 public:
  VideoSource(std::filesystem::path path, const cv::VideoCapture& video, std::optional<double> fps,
              bool counts_frames, int buffers);

  [[nodiscard]] const StreamInfo& info() const override { return info_; }
  [[nodiscard]] ReadResult read(std::chrono::milliseconds timeout) override;
  [[nodiscard]] SourceCounters counters() const override { return {.frames = index_}; }

 private:
  [[nodiscard]] std::int64_t nextTime() const;
  [[nodiscard]] ReadResult atEnd() const;
  [[nodiscard]] Error error(const std::string& reason) const {
    return {path_.string() + ": frame " + std::to_string(index_) + ": " + reason};
  }

  std::filesystem::path path_;
  cv::VideoCapture video_;
  bool own_times_;      // the container's, not those of --fps
  bool counts_frames_;  // the container stores the number of frames
  StreamInfo info_;
  std::uint64_t index_ = 0;    // of the next frame
  std::int64_t last_ns_ = -1;  // time of the frame before
  cv::Mat decoded_;
  FramePool pool_;
};

// Does the file store how many frames it has? AVI and MP4 do; of others OpenCV tells an estimate,
// from a duration that may be that of the sound.
bool countsFrames(const std::filesystem::path& path) {
  char head[12] = {};
  std::ifstream(path, std::ios::binary).read(head, sizeof head);
  const auto has = [&](std::size_t offset, const char* tag) {
    return std::memcmp(head + offset, tag, 4) == 0;
  };
  return (has(0, "RIFF") && has(8, "AVI ")) || has(4, "ftyp");
}

StreamInfo describe(const std::filesystem::path& path, const cv::VideoCapture& video,
                    std::optional<double> fps) {
  StreamInfo info;
  info.width = static_cast<int>(video.get(cv::CAP_PROP_FRAME_WIDTH));
  info.height = static_cast<int>(video.get(cv::CAP_PROP_FRAME_HEIGHT));
  const double declared = video.get(cv::CAP_PROP_FPS);
  const bool sane = declared > 0.0 && declared < kLargestRate;
  info.rate_hz = fps.value_or(sane ? declared : kDefaultRate);
  const double count = video.get(cv::CAP_PROP_FRAME_COUNT);
  info.frame_count = count > 0.0 && count < 1e9 ? static_cast<std::int64_t>(count) : -1;
  char text[64];
  std::snprintf(text, sizeof text, ", %dx%d, %.4g Hz%s", info.width, info.height, info.rate_hz,
                fps || sane ? "" : " (assumed)");
  info.description = path.filename().string() + text;
  return info;
}

VideoSource::VideoSource(std::filesystem::path path, const cv::VideoCapture& video,
                         std::optional<double> fps, bool counts_frames, int buffers)
    : path_(std::move(path)),
      video_(video),
      own_times_(!fps),
      counts_frames_(counts_frames),
      info_(describe(path_, video_, fps)),
      pool_(info_.width, info_.height, buffers) {}

std::int64_t VideoSource::nextTime() const {
  const std::int64_t period_ns = std::llround(1e9 / info_.rate_hz);
  const std::int64_t regular_ns = std::llround(1e9 * static_cast<double>(index_) / info_.rate_hz);
  const double container_ms = video_.get(cv::CAP_PROP_POS_MSEC);
  std::int64_t time_ns = regular_ns;
  if (own_times_ && std::isfinite(container_ms) && std::abs(container_ms) < 1e12) {
    const std::int64_t container_ns = std::llround(container_ms * 1e6);
    if (std::abs(container_ns - regular_ns) > kTick_ns) time_ns = container_ns;
  }
  return index_ == 0 || time_ns > last_ns_ ? time_ns : last_ns_ + period_ns;
}

ReadResult VideoSource::atEnd() const {
  if (index_ == 0) return error("cannot be decoded");
  const std::int64_t missing = info_.frame_count - static_cast<std::int64_t>(index_);
  if (!counts_frames_ || info_.frame_count < 0 || missing <= 0) return EndOfStream{};
  // Recorders leave out dropped frames but count them: then the times still reach the end.
  const double period_ns = 1e9 / info_.rate_hz;
  const double end_ns = period_ns * static_cast<double>(info_.frame_count - 1);
  if (own_times_ && static_cast<double>(last_ns_) > end_ns - 0.5 * period_ns) return EndOfStream{};
  return error("the recording ends here, but its header promises " +
               std::to_string(info_.frame_count) + " frames: truncated or damaged");
}

ReadResult VideoSource::read(std::chrono::milliseconds /*timeout*/) {
  FramePtr frame = pool_.acquire();
  if (!frame) return TimedOut{};  // nothing is lost: the next call goes on here
  try {
    if (!video_.read(decoded_)) return atEnd();
    if (decoded_.cols != info_.width || decoded_.rows != info_.height) {
      return error("is " + sizeText(decoded_.cols, decoded_.rows) + ", the frames before are " +
                   sizeText(info_.width, info_.height));
    }
    cv::Mat grey(info_.height, info_.width, CV_8UC1, frame->pixels());
    // Its weights add up to one exactly, so grey video comes through unchanged.
    cv::cvtColor(decoded_, grey, cv::COLOR_BGR2GRAY);
  } catch (const cv::Exception&) {
    return error("cannot be decoded");
  }
  last_ns_ = nextTime();
  frame->setStamp({.sequence = index_, .monotonic_ns = last_ns_, .utime = last_ns_ / 1000});
  ++index_;
  return frame;
}

}  // namespace

Result<std::unique_ptr<FrameSource>> openVideo(const std::filesystem::path& path,
                                               std::optional<double> fps, int buffers) {
  if (::access(path.c_str(), R_OK) != 0) {
    return Error{path.string() + ": cannot be read: " + systemReason()};
  }
  // FFmpeg talks on stderr about faults that are reported here in one line. The variable is how
  // OpenCV lets one say so; a level set by the user stands.
  ::setenv("OPENCV_FFMPEG_LOGLEVEL", "-8", /*overwrite=*/0);
  cv::VideoCapture video;
  try {
    // A local path, never one of FFmpeg's network protocols.
    const std::string local = std::filesystem::absolute(path).string();
    if (!video.open(local, cv::CAP_FFMPEG)) return Error{path.string() + ": is not a video"};
    video.set(cv::CAP_PROP_ORIENTATION_AUTO, 0);
  } catch (const std::exception&) {
    return Error{path.string() + ": is not a video"};
  }
  if (video.get(cv::CAP_PROP_FRAME_WIDTH) < 1 || video.get(cv::CAP_PROP_FRAME_HEIGHT) < 1) {
    return Error{path.string() + ": is not a video"};
  }
  return std::unique_ptr<FrameSource>(
      std::make_unique<VideoSource>(path, std::move(video), fps, countsFrames(path), buffers));
}

}  // namespace waymark::capture
