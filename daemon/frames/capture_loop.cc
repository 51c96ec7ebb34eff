#include "daemon/frames/capture_loop.h"

#include <algorithm>
#include <string>
#include <thread>
#include <utility>
#include <variant>

namespace waymark::daemon {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

CaptureLoop::CaptureLoop(SourceOpener opener, FrameQueue& frames, CameraStatus& status,
                         const Log& log, const Options& options)
    : opener_(std::move(opener)),
      frames_(frames),
      status_(status),
      log_(log),
      options_(options),
      pause_(options.first_pause) {}

void CaptureLoop::run() {
  while (!stopped() && !over_) {
    if (source_) {
      readUntilTrouble();
    } else if (const Status opened = open(); !opened) {
      lose(opened.error());
    }
  }
  if (source_) countFrames();  // what it dropped since its last frame
  // Of a recording every frame gets its pose. Who stops a camera need not wait for a SLAM that is
  // behind.
  if (over_) {
    frames_.close();
  } else {
    frames_.closeWithNewest();
  }
}

Status CaptureLoop::open() {
  Result<std::unique_ptr<capture::FrameSource>> opened = opener_.open();
  if (!opened) return opened.error();
  source_ = std::move(opened).value();
  sequence_offset_ = next_sequence_;
  if (opened_before_) status_.countReopened();
  opened_before_ = true;
  silence_ = std::max(silenceLimit(opener_.rate_hz, opener_.exposure_s, options_.silence),
                      silenceLimit(source_->info().rate_hz, 0.0, options_.silence));
  log_.info("camera: " + source_->info().description);
  for (const std::string& warning : source_->info().warnings) log_.warning("camera: " + warning);
  status_.setRate(source_->info().rate_hz);
  status_.setRejected(source_->info().warnings.size());
  status_.report(CameraState::kRunning, "");
  return success();
}

// A device is given up when it is silent for longer than its rate and exposure explain.
bool CaptureLoop::silentTooLong(steady_clock::time_point last_frame) const {
  return opener_.comes_back && steady_clock::now() - last_frame > silence_;
}

void CaptureLoop::readUntilTrouble() {
  auto last_frame = steady_clock::now();
  while (!stopped()) {
    capture::ReadResult result = source_->read(options_.read_timeout);
    if (auto* frame = std::get_if<capture::FramePtr>(&result)) {
      last_frame = steady_clock::now();
      handOn(std::move(*frame));
      pause_ = options_.first_pause;
    } else if (std::holds_alternative<capture::EndOfStream>(result)) {
      status_.report(CameraState::kEnded, "the recording is over");
      over_ = true;
      return;
    } else if (const auto* error = std::get_if<Error>(&result)) {
      lose(*error);
      return;
    } else if (silentTooLong(last_frame)) {
      status_.countSilence();
      lose({source_->info().description + ": no frame for " + std::to_string(silence_.count()) +
            " ms"});
      return;
    }
  }
}

void CaptureLoop::handOn(capture::FramePtr frame) {
  if (sequence_offset_ > 0) {
    capture::FrameStamp stamp = frame->stamp();
    stamp.sequence += sequence_offset_;
    frame->setStamp(stamp);
  }
  next_sequence_ = frame->stamp().sequence + 1;
  countFrames();
  if (tap_) tap_(*frame);
  frames_.push(std::move(frame));
}

// Counts before the frame goes on: nobody downstream ever knows of more frames than were captured.
void CaptureLoop::countFrames() { status_.count(earlier_ + source_->counters()); }

void CaptureLoop::lose(const Error& error) {
  if (!opener_.comes_back) {
    failure_ = error;
    over_ = true;
    status_.report(CameraState::kEnded, error.message);
    return;
  }
  const CameraStatus::Report before = status_.latest();
  if (before.reason != error.message) {
    log_.warning("camera: " + error.message + "; trying again");
  }
  status_.report(opened_before_ ? CameraState::kLost : CameraState::kOpening, error.message);
  discardSource();
  pause();
}

// Frames still out belong to the source's buffers: wait until they are back. The SLAM loop lives
// as long as this one, so they will be.
void CaptureLoop::discardSource() {
  if (!source_) return;
  countFrames();
  earlier_ = status_.counters();
  while (!frames_.idle()) std::this_thread::sleep_for(milliseconds(1));
  source_.reset();
}

void CaptureLoop::pause() {
  const auto until = steady_clock::now() + pause_;
  pause_ = std::min(2 * pause_, options_.max_pause);
  while (!stopped() && steady_clock::now() < until) {
    std::this_thread::sleep_for(std::min(pause_, milliseconds(20)));
    if (opener_.device_came && opener_.device_came()) {
      pause_ = options_.first_pause;
      return;
    }
  }
}

}  // namespace waymark::daemon
