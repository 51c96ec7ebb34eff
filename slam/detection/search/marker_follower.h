// Detection from frame to frame: markers are looked for where they should be by now, and the rest
// of the image is searched in turns. It finds what a full scan of every frame would find, a new
// marker a little later, at a fraction of the cost.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "base/image_view.h"
#include "slam/detection/marker_detector.h"
#include "slam/detection/scan_budget.h"
#include "slam/detection/search/border_entry_detector.h"
#include "slam/detection/search/scan_schedule.h"
#include "slam/stages.h"

namespace waymark::slam {

struct FollowerOptions {
  // Off: every frame is scanned as a whole, however long that takes.
  bool enabled = true;
  ScanScheduleOptions schedule;
  BorderEntryOptions border;
  // Where a marker is not where it was expected, this far around the place is searched, pixels.
  int search_px = 16;
  // Of the markers of the last frame, the least share that has to be found again; else the motion
  // was not what was expected, and the whole image is searched at once.
  double min_found = 0.5;
  // Beyond this much motion from frame to frame, as a share of the image's shorter side, so much
  // comes into view that the whole image is searched.
  double max_flow = 0.04;
  // Markers that have come into view, as the map has it: so many are looked for in a frame.
  std::size_t newcomers = 4;
  // They have to be so far within the image, pixels, and so large in it, pixels squared: what is
  // cut off or seen from the edge on is not found.
  double newcomer_margin_px = 3.0;
  double newcomer_area_px2 = 100.0;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

// Where the map has a marker, normalized: in the last frame and in this one.
struct ExpectedMarker {
  int id = -1;
  std::array<Eigen::Vector2d, 4> before;
  std::array<Eigen::Vector2d, 4> now;
};

enum class SearchMode {
  kFullScan,
  kFollowing,
  kInTurns,  // nothing to follow, and too busy to be scanned as a whole
};

class MarkerFollower {
 public:
  // The camera must outlive the follower.
  MarkerFollower(const CameraModel& camera, Dictionary dictionary, const DetectorOptions& detector,
                 const FollowerOptions& options);

  // Sorted by id; where two prints of one id are seen, both. Valid until the next call. `expected`:
  // sorted by id; of the markers seen in the last frame those that are not among them are expected
  // to move on in the image as they did. `observer` may be null.
  const std::vector<MarkerDetection>& find(const ImageView& image, std::int64_t time_ns,
                                           std::span<const ExpectedMarker> expected,
                                           StageObserver* observer = nullptr);

  // How the last frame was searched.
  [[nodiscard]] SearchMode mode() const { return mode_; }
  // What the last frame showed, largest marker first; where an id is there twice, both.
  struct Followed {
    MeasuredMarker measured;
    std::array<Eigen::Vector2d, 4> velocity;  // of the normalized corners, per second
  };
  [[nodiscard]] std::span<const Followed> followed() const { return followed_; }
  [[nodiscard]] const DetectorCounters& counters() const { return detector_.counters(); }
  [[nodiscard]] const Dictionary& dictionary() const { return detector_.dictionary(); }
  // What was looked at in all frames.
  [[nodiscard]] const ScanWork& work() const { return detector_.work(); }

 private:
  using Corners = std::array<Eigen::Vector2d, 4>;

  // Whether enough of the last frame's markers were found.
  [[nodiscard]] bool follow(const ImageView& image, std::span<const ExpectedMarker> expected,
                            double interval_s);
  [[nodiscard]] const MeasuredMarker* searchAround(const ImageView& image, const Corners& corners,
                                                   int id);
  void scanWhole(const ImageView& image, double interval_s);
  // Beside what has entered, what has its turn.
  void scanTurns(const ImageView& image, double interval_s, std::span<const SearchRegion> entered);
  void scanAll(const ImageView& image, std::span<const SearchRegion> regions);
  [[nodiscard]] bool isBusy() const { return busy_frames_ > 0; }
  void becomeBusy();
  void lookForNewcomers(const ImageView& image, std::span<const ExpectedMarker> expected);
  [[nodiscard]] Eigen::Vector2d flow() const;
  [[nodiscard]] bool shouldBeSeen(const ExpectedMarker& marker) const;
  void remember(double interval_s);
  [[nodiscard]] const MarkerDetection* nearestBefore(const MarkerDetection& now) const;
  [[nodiscard]] bool isSeen(int id) const;

  FollowerOptions options_;
  ScanBudgetOptions budget_;
  MarkerDetector detector_;
  ScanSchedule schedule_;
  BorderEntryDetector border_;
  SearchMode mode_ = SearchMode::kFullScan;
  int busy_frames_ = 0;            // for which the image is not scanned as a whole
  std::uint32_t frames_ = 0;       // so far
  std::uint32_t whole_scans_ = 0;  // so far
  std::int64_t time_ns_ = 0;
  std::vector<Followed> followed_;
  std::vector<Followed> next_;  // reused from frame to frame
  std::vector<SearchRegion> regions_;
  std::size_t newcomer_ = 0;  // where among the expected ones the search goes on
};

}  // namespace waymark::slam
