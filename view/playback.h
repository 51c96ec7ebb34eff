// A recording of the daemon's, played into the live state with a time line: the page shows it as it
// would have been.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/result.h"
#include "capture/eventlog/log_reader.h"
#include "capture/jpeg_encoder.h"
#include "io/text/json_node.h"
#include "view/live_state.h"
#include <waymark/preview_t.hpp>

namespace waymark::view {

class Playback {
 public:
  // Reads the log once to know its times. The state must outlive it. Errors name the file.
  [[nodiscard]] static Result<Playback> open(const std::filesystem::path& file,
                                             std::string channel_prefix, std::string body_channel);

  // Time passes, monotonic: what was recorded in it is shown.
  void tick(std::int64_t now_ns, LiveState* state);
  // {"command":"play"}, "pause", or "seek" with "to_s" from the beginning. The reply of a command.
  [[nodiscard]] io::Json command(const std::string& text);
  // {"type":"playback","name","length_s","now_s","playing"}
  [[nodiscard]] io::Json status() const;

 private:
  // Where in the file an event of that time is.
  struct Place {
    std::int64_t utime = 0;
    std::uint64_t offset = 0;
  };

  Playback(std::filesystem::path file, eventlog::LogReader reader)
      : file_(std::move(file)), reader_(std::move(reader)) {}
  [[nodiscard]] Status readTimes();
  void goTo(std::int64_t utime);
  void feedUntil(std::int64_t utime, std::int64_t now_ns, LiveState* state);
  void feed(const eventlog::Event& event, std::int64_t now_ns, LiveState* state);
  void keepImage(const eventlog::Event& event);

  std::filesystem::path file_;
  eventlog::LogReader reader_;
  std::string prefix_;
  std::string body_channel_;
  std::vector<Place> places_;  // one a second
  std::int64_t begin_utime_ = 0;
  std::int64_t end_utime_ = 0;

  std::optional<eventlog::Event> next_;  // read, and not shown yet
  std::int64_t shown_utime_ = 0;
  std::int64_t ticked_ns_ = 0;
  bool playing_ = true;
  bool images_only_ = true;  // nothing of a daemon is in it
  std::uint64_t image_number_ = 0;
  std::optional<preview_t> image_;  // the newest, not shown yet
  std::optional<preview_t>
      waiting_;  // shown with the next tick, when what was found in it is there
  std::unique_ptr<capture::JpegEncoder> jpeg_ = std::make_unique<capture::JpegEncoder>();
};

}  // namespace waymark::view
