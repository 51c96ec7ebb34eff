#include "slam/detection/search/marker_follower.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/elapsed.h"
#include "slam/geometry/plane.h"
#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

using Corners = std::array<Eigen::Vector2d, 4>;

double imageSize(const MeasuredMarker& measured) {
  const auto& pixels = measured.detection.pixels;
  return std::abs(cross(pixels[2] - pixels[0], pixels[3] - pixels[1]));
}

void shift(const Eigen::Vector2d& by, Corners* corners) {
  for (Eigen::Vector2d& corner : *corners) corner += by;
}

const ExpectedMarker* findExpected(std::span<const ExpectedMarker> expected, int id) {
  const auto found = std::ranges::lower_bound(expected, id, {}, &ExpectedMarker::id);
  return found != expected.end() && found->id == id ? &*found : nullptr;
}

}  // namespace

std::string FollowerOptions::invalidReason() const {
  return firstReason({
      schedule.invalidReason(),
      border.invalidReason(),
      firstUnmet({
          {search_px >= 0, "the search around a marker's place must not be negative"},
          {isShare(min_found), "the share of markers found again must be from 0 to 1"},
          {isNotNegative(max_flow), "the largest flow must not be negative"},
          {isNotNegative(newcomer_margin_px), "the margin of newcomers must not be negative"},
          {isNotNegative(newcomer_area_px2), "the least area of newcomers must not be negative"},
      }),
  });
}

MarkerFollower::MarkerFollower(const CameraModel& camera, Dictionary dictionary,
                               const DetectorOptions& detector, const FollowerOptions& options)
    : options_(options),
      budget_(detector.budget),
      detector_(camera, std::move(dictionary), detector),
      schedule_(camera.width(), camera.height(), options.schedule),
      border_(camera.width(), camera.height(), schedule_.coarsest(), options.schedule.overlap_px,
              options.border) {
  if (!options.enabled) return;
  detector_.setBudget(ScanBudget::ofFrame(budget_, camera.width(), camera.height()));
}

const std::vector<MarkerDetection>& MarkerFollower::find(const ImageView& image,
                                                         std::int64_t time_ns,
                                                         std::span<const ExpectedMarker> expected,
                                                         StageObserver* observer) {
  const double interval_s = secondsBetween(time_ns_, time_ns);
  time_ns_ = time_ns;
  detector_.begin();
  detector_.setObserver(observer);
  ++frames_;
  if (isBusy()) --busy_frames_;
  const std::span<const SearchRegion> entered = border_.next(image);
  const bool may_follow = options_.enabled && interval_s > 0.0 && !followed_.empty();
  const bool followed = may_follow && follow(image, expected, interval_s);
  // What is searched as a whole is searched without what was found by chance.
  if (!followed && !isBusy()) detector_.begin();
  const Eigen::Vector2d flow_px = flow();
  const bool fast = flow_px.norm() > options_.max_flow * std::min(image.width, image.height);
  mode_ = followed && !fast ? SearchMode::kFollowing : SearchMode::kFullScan;
  if (mode_ == SearchMode::kFollowing) {
    lookForNewcomers(image, expected);
    scanTurns(image, interval_s, entered);
  } else {
    scanWhole(image, interval_s);
  }
  remember(interval_s);
  return detector_.finish();
}

// Large markers first: what their motion was not expected to be, the others' will not be either.
bool MarkerFollower::follow(const ImageView& image, std::span<const ExpectedMarker> expected,
                            double interval_s) {
  Eigen::Vector2d innovation = Eigen::Vector2d::Zero();  // of the markers found so far
  std::size_t found = 0;
  for (const Followed& followed : followed_) {
    const MarkerDetection& last = followed.measured.detection;
    const ExpectedMarker* const known = findExpected(expected, last.id);
    Corners corners = last.normalized;
    for (std::size_t k = 0; k < 4; ++k) {
      corners[k] += known != nullptr ? Eigen::Vector2d(known->now[k] - known->before[k])
                                     : Eigen::Vector2d(interval_s * followed.velocity[k]);
    }
    const Eigen::Vector2d without_innovation = centreOf(corners);
    shift(innovation, &corners);
    const bool confirmed = detector_.confirm(image, last.id, corners, &followed.measured);
    const MeasuredMarker* const measured =
        confirmed ? &detector_.measured().back() : searchAround(image, corners, last.id);
    if (measured == nullptr) continue;
    const Eigen::Vector2d centre = centreOf(measured->detection.normalized);
    innovation += (centre - without_innovation - innovation) / static_cast<double>(++found);
  }
  return static_cast<double>(found) >= options_.min_found * static_cast<double>(followed_.size());
}

// Null when it is not there.
const MeasuredMarker* MarkerFollower::searchAround(const ImageView& image, const Corners& corners,
                                                   int id) {
  Quad quad;
  for (std::size_t k = 0; k < 4; ++k) quad[k] = detector_.camera().distort(corners[k]);
  const Window window = windowAround(quad, options_.search_px, image);
  if (window.width == 0 || window.height == 0) return nullptr;
  const auto before = static_cast<std::ptrdiff_t>(detector_.measured().size());
  (void)detector_.scan(image, {.window = window, .turn = frames_}, budget_.lost_marker_share);
  const auto& measured = detector_.measured();
  const auto found = std::find_if(measured.begin() + before, measured.end(),
                                  [id](const MeasuredMarker& s) { return s.detection.id == id; });
  return found == measured.end() ? nullptr : &*found;
}

// At once; where there is too much for that, in turns from the next frame on.
void MarkerFollower::scanWhole(const ImageView& image, double interval_s) {
  if (isBusy()) {
    mode_ = SearchMode::kInTurns;
    scanAll(image, schedule_.next(interval_s, budget_.busy_frames));
    return;
  }
  // Images that nothing is followed in may have nothing to do with each other.
  const std::uint32_t turn = options_.enabled ? whole_scans_++ : 0;
  if (detector_.scanAll(image, turn) == ScanOutcome::kDone) return;
  mode_ = SearchMode::kInTurns;
  becomeBusy();
}

void MarkerFollower::scanTurns(const ImageView& image, double interval_s,
                               std::span<const SearchRegion> entered) {
  const auto due = schedule_.next(interval_s, isBusy() ? budget_.busy_frames : 1);
  regions_.clear();
  // In a busy image something crosses the border all the time.
  if (!isBusy()) regions_.assign(entered.begin(), entered.end());
  for (SearchRegion& region : regions_) region.turn = frames_;
  regions_.insert(regions_.end(), due.begin(), due.end());
  scanAll(image, regions_);
}

// Each gets as much of what is left as it has of the pixels that are left.
void MarkerFollower::scanAll(const ImageView& image, std::span<const SearchRegion> regions) {
  double px = 0.0;
  for (const SearchRegion& region : regions) px += searchedPixels(region);
  const auto runs = isBusy() ? MarkerDetector::Runs::kUnbounded : MarkerDetector::Runs::kBounded;
  for (const SearchRegion& region : regions) {
    const double region_px = searchedPixels(region);
    const auto outcome = detector_.scan(image, region, region_px / px, runs);
    px -= region_px;
    if (outcome == ScanOutcome::kTooBusy) becomeBusy();
  }
}

// Until all of it has had its turn.
void MarkerFollower::becomeBusy() { busy_frames_ = 2 * budget_.busy_frames; }

// A few a frame, one after the other: some never come, hidden by what the map does not know of.
void MarkerFollower::lookForNewcomers(const ImageView& image,
                                      std::span<const ExpectedMarker> expected) {
  std::size_t tries = 0;
  for (std::size_t i = 0; i < expected.size() && tries < options_.newcomers; ++i) {
    newcomer_ = (newcomer_ + 1) % expected.size();
    const ExpectedMarker& marker = expected[newcomer_];
    const bool was_there = std::ranges::any_of(followed_, [&](const Followed& followed) {
      return followed.measured.detection.id == marker.id;
    });
    if (was_there || isSeen(marker.id) || !shouldBeSeen(marker)) continue;
    ++tries;
    (void)detector_.confirm(image, marker.id, marker.now, nullptr);
  }
}

// How the markers found so far have moved in the image since the last frame, pixels.
Eigen::Vector2d MarkerFollower::flow() const {
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  int count = 0;
  for (const MeasuredMarker& measured : detector_.measured()) {
    const MarkerDetection* const before = nearestBefore(measured.detection);
    if (before == nullptr) continue;
    sum += centreOf(measured.detection.pixels) - centreOf(before->pixels);
    ++count;
  }
  return sum / std::max(count, 1);
}

// Wholly in the image, from the front, and not from the edge on.
bool MarkerFollower::shouldBeSeen(const ExpectedMarker& marker) const {
  Corners pixels;
  for (std::size_t k = 0; k < 4; ++k) {
    pixels[k] = detector_.camera().distort(marker.now[k]);
    if (!detector_.camera().inImage(pixels[k], options_.newcomer_margin_px)) return false;
  }
  const double area_px2 = 0.5 * cross(pixels[2] - pixels[0], pixels[3] - pixels[1]);
  return area_px2 > options_.newcomer_area_px2;
}

void MarkerFollower::remember(double interval_s) {
  next_.clear();
  for (const MeasuredMarker& measured : detector_.measured()) {
    Corners velocity;
    velocity.fill(Eigen::Vector2d::Zero());
    const MarkerDetection* const before = nearestBefore(measured.detection);
    for (std::size_t k = 0; k < 4 && before != nullptr && interval_s > 0.0; ++k) {
      velocity[k] = (measured.detection.normalized[k] - before->normalized[k]) / interval_s;
    }
    next_.push_back({measured, velocity});
  }
  std::ranges::sort(next_, std::ranges::greater{},
                    [](const Followed& f) { return imageSize(f.measured); });
  std::swap(followed_, next_);
}

// The same marker in the last frame; null when it was not there. Where its id is there twice, the
// nearer of two prints, unless that is nearer to the other one.
const MarkerDetection* MarkerFollower::nearestBefore(const MarkerDetection& now) const {
  const auto apart = [](const MarkerDetection& a, const MarkerDetection& b) {
    return (centreOf(a.normalized) - centreOf(b.normalized)).squaredNorm();
  };
  const MarkerDetection* nearest = nullptr;
  for (const Followed& followed : followed_) {
    const MarkerDetection& before = followed.measured.detection;
    if (before.id != now.id) continue;
    if (nearest == nullptr || apart(before, now) < apart(*nearest, now)) nearest = &before;
  }
  const bool is_anothers =
      nearest != nullptr &&
      std::ranges::any_of(detector_.measured(), [&](const MeasuredMarker& other) {
        return other.detection.id == now.id &&
               apart(*nearest, other.detection) < apart(*nearest, now);
      });
  return is_anothers ? nullptr : nearest;
}

bool MarkerFollower::isSeen(int id) const {
  return std::ranges::any_of(detector_.measured(),
                             [id](const MeasuredMarker& s) { return s.detection.id == id; });
}

}  // namespace waymark::slam
