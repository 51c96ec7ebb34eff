// The SLAM thread: frames out of the queue, through the SLAM, results into another queue. Per frame
// it neither logs, nor allocates, nor takes a lock of its own.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <utility>

#include <readerwriterqueue/readerwritercircularbuffer.h>

#include "daemon/frames/capture_loop.h"
#include "daemon/frames/frame_record.h"
#include "daemon/frames/slam_requests.h"
#include "daemon/frames/stage_clock.h"
#include "daemon/frames/triple_buffer.h"
#include "daemon/natural/relocalizer_link.h"
#include "daemon/preview/preview_link.h"
#include "slam/slam.h"

namespace waymark::daemon {

// What flows from the SLAM loop to the publisher. When the publisher lags, records are lost and
// counted; the SLAM loop never waits for it.
struct SlamOutput {
  // At 150 Hz nearly half a second: longer than any hiccup of a healthy network stack.
  static constexpr std::size_t kRecords = 64;

  moodycamel::BlockingReaderWriterCircularBuffer<FrameRecord> records{kRecords};
  std::atomic<std::uint64_t> records_lost{0};
  TripleBuffer<MapSnapshot> map;
  // Monotonic: when the loop last came round, or got on within a frame.
  std::atomic<std::int64_t> alive_ns{0};
  std::atomic<std::int64_t> frame_began_ns{0};  // monotonic; 0 between frames
  std::atomic<bool> finished{false};            // nothing more will come
  // Grows when the map changes: a map copied or saved at the same count is the same map.
  std::atomic<std::uint64_t> map_revision{0};
  std::atomic<int> map_markers{0};  // with a pose, in the map last handed on
  std::atomic<int> map_natural_markers{0};
  std::atomic<int> map_keyframes{0};
  std::atomic<int> map_pieces{1};  // in the map last handed on
};

class SlamLoop {
 public:
  struct Options {
    // A frame that takes longer than the time between two frames has missed its deadline. Of a
    // camera that does not say how fast it goes:
    double usual_rate_hz = 150.0;
    // The map is handed on at most this often (in frame time): it changes in bursts.
    std::int64_t map_interval_ns = 100'000'000;
  };

  SlamLoop(std::unique_ptr<slam::Slam> slam, FrameQueue& frames, const CameraStatus& camera,
           SlamRequests& requests, SlamOutput& output, const Options& options);
  SlamLoop(std::unique_ptr<slam::Slam> slam, FrameQueue& frames, const CameraStatus& camera,
           SlamRequests& requests, SlamOutput& output)
      : SlamLoop(std::move(slam), frames, camera, requests, output, Options{}) {}

  // Who looks for natural markers in its frames; must outlive it. Before run().
  void setRelocalizer(RelocalizerLink* relocalizer) { relocalizer_ = relocalizer; }

  // Who makes small images of its frames; must outlive it. Before run().
  void setPreview(PreviewLink* preview) { preview_ = preview; }

  // The thread's body. Returns when the queue is closed and empty. Comes round with every frame,
  // and when the queue is woken.
  void run();

  // After run().
  [[nodiscard]] slam::Slam& slam() { return *slam_; }
  // Of all SLAMs that there have been.
  [[nodiscard]] slam::Counters counters() const;

 private:
  void serveRequest();
  void process(const capture::Frame& frame);
  void record(const capture::FrameStamp& stamp, const slam::FrameInput& input,
              const slam::FrameResult& result, std::int64_t processing_ns);
  void recordLens();
  void givePreviewWhenDue(const slam::FrameInput& input, const slam::FrameResult& result);
  void countMapChange();
  void reportMapSize(const MapSnapshot& snapshot, std::size_t pieces);
  [[nodiscard]] bool tookTooLong(std::int64_t processing_ns) const;
  void handOnMapWhenDue(const capture::FrameStamp& stamp);
  void handOnMap(const capture::FrameStamp& stamp);

  std::unique_ptr<slam::Slam> slam_;
  slam::Counters earlier_;  // of the SLAMs before this one
  FrameQueue& frames_;
  const CameraStatus& camera_;
  SlamRequests& requests_;
  SlamOutput& output_;
  const Options options_;
  RelocalizerLink* relocalizer_ = nullptr;  // null: there are no natural markers
  PreviewLink* preview_ = nullptr;          // null: nobody does
  StageClock clock_{&output_.alive_ns};
  FrameRecord record_;
  capture::FrameStamp last_stamp_;
  bool map_changed_ = false;
  std::int64_t next_map_ns_ = 0;  // monotonic
};

}  // namespace waymark::daemon
