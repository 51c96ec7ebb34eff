#include "view/playback.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <bot_core/image_t.hpp>

#include "capture/recorded_image.h"
#include "view/decode_message.h"

namespace waymark::view {
namespace {

using io::Json;

constexpr std::int64_t kSecond_us = 1'000'000;
// What is shown after a jump was told before: the map every five seconds, at least.
constexpr std::int64_t kBefore_us = 6 * kSecond_us;

template <typename Message>
void give(const eventlog::Event& event, std::int64_t now_ns, LiveState* state) {
  addDecoded<Message>(event.data.data(), event.data.size(), now_ns, state);
}

}  // namespace

Result<Playback> Playback::open(const std::filesystem::path& file, std::string channel_prefix,
                                std::string body_channel) {
  Result<eventlog::LogReader> reader = eventlog::LogReader::open(file);
  if (!reader) return reader.error();
  Playback playback(file, std::move(reader).value());
  playback.prefix_ = std::move(channel_prefix);
  playback.body_channel_ = std::move(body_channel);
  if (Status read = playback.readTimes(); !read) return read.error();
  playback.goTo(playback.begin_utime_);
  return playback;
}

Status Playback::readTimes() {
  for (;;) {
    const std::uint64_t offset = reader_.endOfLast();
    auto event = reader_.next();
    if (!event) return event.error();
    if (!*event) break;
    const std::int64_t utime = (*event)->utime;
    if (places_.empty()) begin_utime_ = end_utime_ = utime;
    if (places_.empty() || utime >= places_.back().utime + kSecond_us) {
      places_.push_back({utime, offset});
    }
    end_utime_ = std::max(end_utime_, utime);
    if ((*event)->channel.starts_with(prefix_)) images_only_ = false;
  }
  if (places_.empty()) return Error{file_.string() + ": has no events of an LCM log"};
  return success();
}

void Playback::goTo(std::int64_t utime) {
  const auto after = std::ranges::upper_bound(places_, utime, {}, &Place::utime);
  reader_.seek(after == places_.begin() ? 0 : std::prev(after)->offset);
  next_.reset();
  image_.reset();
  waiting_.reset();
}

void Playback::tick(std::int64_t now_ns, LiveState* state) {
  if (waiting_) state->add(*std::exchange(waiting_, std::nullopt), now_ns);
  if (shown_utime_ == 0) shown_utime_ = begin_utime_;
  std::int64_t until = shown_utime_;
  if (playing_ && ticked_ns_ != 0) until += (now_ns - ticked_ns_) / 1000;
  ticked_ns_ = now_ns;
  if (until >= end_utime_) {
    until = end_utime_;
    playing_ = false;
  }
  feedUntil(until, now_ns, state);
  shown_utime_ = until;
  if (image_) waiting_ = std::exchange(image_, std::nullopt);
  state->keepAlive(now_ns);
  state->setPlayback(status());
}

void Playback::feedUntil(std::int64_t utime, std::int64_t now_ns, LiveState* state) {
  for (;;) {
    if (!next_) {
      auto event = reader_.next();
      if (!event || !*event) return;
      next_ = **event;
    }
    if (next_->utime > utime) return;
    feed(*next_, now_ns, state);
    next_.reset();
  }
}

void Playback::feed(const eventlog::Event& event, std::int64_t now_ns, LiveState* state) {
  if (event.channel == body_channel_) return give<bot_core::pose_t>(event, now_ns, state);
  if (event.channel.starts_with(prefix_)) {
    const std::string_view name = event.channel.substr(prefix_.size());
    if (name == "POSE") return give<pose_t>(event, now_ns, state);
    if (name == "MAP") return give<map_t>(event, now_ns, state);
    if (name == "HEALTH") return give<health_t>(event, now_ns, state);
    if (name == "DETECTIONS") return give<detections_t>(event, now_ns, state);
    if (name == "NATURAL_MAP") return give<natural_map_t>(event, now_ns, state);
    if (name == "NATURAL") return give<natural_detections_t>(event, now_ns, state);
    return;
  }
  if (capture::isImage(event.data)) keepImage(event);
}

// As a preview message would bring it; the one before, if it was not shown, is passed over.
void Playback::keepImage(const eventlog::Event& event) {
  bot_core::image_t image;
  capture::FrameStamp stamp;
  if (!capture::readImage(event.data, image_number_++, &image, &stamp)) return;
  preview_t preview{};
  preview.utime = image.utime;
  preview.sequence = static_cast<std::int64_t>(stamp.sequence);
  preview.width = image.width;
  preview.height = image.height;
  if (image.pixelformat == bot_core::image_t::PIXEL_FORMAT_MJPEG) {
    preview.jpeg = std::move(image.data);
  } else {
    constexpr int kQuality = 70;
    const auto bytes =
        jpeg_->encode({image.data.data(), image.width, image.height, image.row_stride}, kQuality);
    preview.jpeg.assign(bytes.begin(), bytes.end());
  }
  preview.size = static_cast<std::int32_t>(preview.jpeg.size());
  image_ = std::move(preview);
}

Json Playback::command(const std::string& text) {
  const auto answer = [](bool ok, const char* error) {
    return ok ? Json{{"type", "answer"}, {"ok", true}}
              : Json{{"type", "answer"}, {"ok", false}, {"error", error}};
  };
  const Result<Json> parsed = io::parseJson(text, "command");
  if (!parsed || !parsed->is_object() || !parsed->contains("command")) {
    return answer(false, "a command is {\"command\": NAME}");
  }
  const Json& name = (*parsed)["command"];
  if (name == "pause") {
    playing_ = false;
  } else if (name == "play") {
    playing_ = true;
    if (shown_utime_ >= end_utime_) {
      shown_utime_ = begin_utime_;
      goTo(begin_utime_);
    }
  } else if (name == "seek" && parsed->contains("to_s") && (*parsed)["to_s"].is_number()) {
    const double to_s = (*parsed)["to_s"];
    const double length_s = 1e-6 * static_cast<double>(end_utime_ - begin_utime_);
    if (!(to_s >= 0.0 && to_s <= length_s + 1.0)) return answer(false, "there is no such time");
    shown_utime_ = std::min(end_utime_, begin_utime_ + static_cast<std::int64_t>(1e6 * to_s));
    goTo(std::max(begin_utime_, shown_utime_ - kBefore_us));
  } else {
    return answer(false, "there is no such command");
  }
  return answer(true, "");
}

Json Playback::status() const {
  const auto seconds = [&](std::int64_t utime) {
    return 1e-6 * static_cast<double>(utime - begin_utime_);
  };
  return {{"type", "playback"},
          {"name", file_.filename().string()},
          {"length_s", seconds(end_utime_)},
          {"now_s", seconds(std::max(shown_utime_, begin_utime_))},
          {"playing", playing_},
          {"images_only", images_only_}};
}

}  // namespace waymark::view
