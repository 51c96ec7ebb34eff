#include "tools/calibration_broadcast.h"

#include <utility>
#include <vector>

#include <waymark/calibration_t.hpp>
#include <waymark/preview_t.hpp>

namespace waymark::tools {
namespace {

constexpr std::int64_t kInterval_ns = 240'000'000;  // as the daemon's previews

calibration_t messageOf(const capture::Frame& frame, const calibration::BoardView* board_view,
                        const calibration::ViewCollector& collected,
                        const calibration::Advice& advice, const CalibrationRun& run) {
  calibration_t message{};
  message.utime = frame.stamp().utime;
  message.monotonic_ns = frame.stamp().monotonic_ns;
  message.sequence = static_cast<std::int64_t>(frame.stamp().sequence);
  message.width = frame.image().width;
  message.height = frame.image().height;
  message.advice = advice.text;
  message.enough = advice.enough ? 1 : 0;
  message.frames = static_cast<std::int32_t>(run.frames);
  message.frames_with_board = static_cast<std::int32_t>(run.with_board);
  message.views = static_cast<std::int32_t>(collected.count());
  const calibration::Coverage& coverage = collected.coverage();
  message.columns = coverage.grid().columns;
  message.rows = coverage.grid().rows;
  message.cells = coverage.grid().cells();
  message.points_in_cell.assign(coverage.counts().begin(), coverage.counts().end());
  if (board_view == nullptr) return message;
  for (const calibration::BoardPoint& point : board_view->points) {
    const Eigen::Vector2f pixel = point.pixel.cast<float>();
    message.points_px.push_back({pixel.x(), pixel.y()});
  }
  message.count = static_cast<std::int32_t>(message.points_px.size());
  return message;
}

}  // namespace

// Nobody needs to listen: what cannot be sent is not spoken of.
CalibrationBroadcast::CalibrationBroadcast(const std::string& url, std::string channel_prefix)
    : prefix_(std::move(channel_prefix)),
      log_(daemon::LogLevel::kError, /*for_journal=*/false, "waymark"),
      out_(url, log_) {}

template <typename Message>
void CalibrationBroadcast::publish(const char* channel, const Message& message) {
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(message.getEncodedSize()));
  message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  (void)out_.publish(prefix_ + channel, bytes);
}

void CalibrationBroadcast::send(const capture::Frame& frame,
                                const calibration::BoardView* board_view,
                                const calibration::ViewCollector& collected,
                                const calibration::Advice& advice, const CalibrationRun& run,
                                std::int64_t now_ns) {
  next_ns_ = now_ns + kInterval_ns;
  if (!out_.maintain(now_ns)) return;
  const calibration_t told = messageOf(frame, board_view, collected, advice, run);
  publish("CALIBRATION", told);
  preview_t preview{};
  preview.utime = told.utime;
  preview.monotonic_ns = told.monotonic_ns;
  preview.sequence = told.sequence;
  preview.width = told.width;
  preview.height = told.height;
  if (image_.encode(image_.reduce(frame.image()).image, &preview)) publish("PREVIEW", preview);
}

}  // namespace waymark::tools
