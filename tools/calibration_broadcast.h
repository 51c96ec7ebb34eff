// What `waymark calibrate` sees and wants, told to whoever looks by waymark-view: a few times a
// second, by LCM.
#pragma once

#include <cstdint>
#include <string>

#include "capture/frame.h"
#include "daemon/preview/preview_image.h"
#include "daemon/publish/lcm_link.h"
#include "daemon/system/log.h"
#include "tools/calibration/guide.h"
#include "tools/calibration/view_collector.h"
#include "tools/calibration_output.h"

namespace waymark::tools {

class CalibrationBroadcast {
 public:
  // Precondition: url is a multicast one.
  CalibrationBroadcast(const std::string& url, std::string channel_prefix);

  // Whether it is time for a message again.
  [[nodiscard]] bool due(std::int64_t now_ns) const { return now_ns >= next_ns_; }
  // board_view: null where the frame does not show the board.
  void send(const capture::Frame& frame, const calibration::BoardView* board_view,
            const calibration::ViewCollector& collected, const calibration::Advice& advice,
            const CalibrationRun& run, std::int64_t now_ns);

 private:
  template <typename Message>
  void publish(const char* channel, const Message& message);

  const std::string prefix_;
  const daemon::Log log_;
  daemon::LcmLink out_;
  std::int64_t next_ns_ = 0;
  daemon::PreviewImage image_;
};

}  // namespace waymark::tools
