#include "tests/bench/pattern_runs.h"

#include <algorithm>
#include <cstdio>
#include <functional>
#include <iterator>
#include <numeric>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "base/clock.h"
#include "simulator/simulation.h"
#include "slam/detection/search/marker_follower.h"
#include "tests/bench/patterns.h"
#include "tools/calibration/board_detector.h"

namespace waymark::bench {
namespace {

constexpr double kMostTimesOrdinary = 3.0;
constexpr double kFindWithin_s = 0.5;

const slam::Dictionary& dictionary() {
  static const slam::Dictionary tags = *slam::Dictionary::byName("APRILTAG_36h11");
  return tags;
}

// What a follower made of a sequence.
struct Run {
  std::vector<double> cpu_ms;           // by frame
  std::vector<std::set<int>> found;     // ids, by frame
  std::vector<slam::SearchMode> modes;  // by frame
};

double mean(const std::vector<double>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}
double worst(const std::vector<double>& values) { return *std::ranges::max_element(values); }

using Frames = std::function<ImageView(int)>;

class Runner {
 public:
  Runner(const PatternRunOptions& options, const slam::CameraModel& camera)
      : options_(options), camera_(camera) {}

  [[nodiscard]] Run run(int count, const slam::FollowerOptions& follower,
                        const Frames& frames) const {
    Run best = once(count, follower, frames);
    for (int i = 1; i < options_.repeats; ++i) {
      const Run again = once(count, follower, frames);
      for (std::size_t k = 0; k < best.cpu_ms.size(); ++k) {
        best.cpu_ms[k] = std::min(best.cpu_ms[k], again.cpu_ms[k]);
      }
    }
    return best;
  }

  [[nodiscard]] Run once(int count, const slam::FollowerOptions& options,
                         const Frames& frames) const {
    slam::MarkerFollower follower(camera_, dictionary(), {}, options);
    Run run;
    for (int k = 0; k < count; ++k) {
      const ImageView image = frames(k);
      const auto time_ns = static_cast<std::int64_t>(1e9 * (k + 1) / options_.rate_hz);
      const std::int64_t before_ns = threadCpuNs();
      const auto& found = follower.find(image, time_ns, {});
      run.cpu_ms.push_back(1e-6 * static_cast<double>(threadCpuNs() - before_ns));
      std::set<int>& ids = run.found.emplace_back();
      for (const slam::MarkerDetection& detection : found) ids.insert(detection.id);
      run.modes.push_back(follower.mode());
    }
    return run;
  }

 private:
  const PatternRunOptions& options_;
  const slam::CameraModel& camera_;
};

// A room with markers on its walls.
struct Ordinary {
  Run full_scans;
  Run following;
};

std::optional<Ordinary> runOrdinary(const PatternRunOptions& options) {
  simulator::Options room;
  room.scene = "walls";
  room.dictionary = "APRILTAG_36h11";
  room.size = simulator::ImageSize{options.width, options.height};
  room.rate_hz = options.rate_hz;
  const auto simulation = simulator::Simulation::create(room, simulator::Ending::kOfTheScene);
  if (!simulation) {
    std::fprintf(stderr, "clutter_bench: %s\n", simulation.error().message.c_str());
    return std::nullopt;
  }
  std::vector<std::vector<std::uint8_t>> images;
  simulator::Simulation::Workspace workspace;
  for (int k = 0; k < options.frames; ++k) {
    auto& image = images.emplace_back(static_cast<std::size_t>(options.width) *
                                      static_cast<std::size_t>(options.height));
    (*simulation)->render(k, &workspace, image.data());
  }
  const Frames frames = [&](int k) {
    return ImageView{images[static_cast<std::size_t>(k)].data(), options.width, options.height,
                     options.width};
  };
  const slam::CameraModel camera((*simulation)->camera());
  const Runner runner(options, camera);
  slam::FollowerOptions scanning;
  scanning.enabled = false;
  return Ordinary{runner.run(options.frames, scanning, frames),
                  runner.run(options.frames, {}, frames)};
}

// Two that are there from the start, and two that come later: one large, one small of each.
std::vector<PlacedMarker> markersOf(const PatternRunOptions& options, bool with_newcomers) {
  const int w = options.width;
  const int h = options.height;
  std::vector<PlacedMarker> markers = {{3, w / 5, h / 4, 6}, {7, 3 * w / 5, h / 3, 4}};
  if (with_newcomers) {
    markers.push_back({11, w / 3, 3 * h / 5, 6});
    markers.push_back({19, 4 * w / 5, 3 * h / 4, 3});
  }
  return markers;
}

// From 0 to the room there is, and back.
int toAndFro(int way_px) {
  constexpr int kRoom = PatternPicture::kRoomPx;
  const int place = way_px % (2 * kRoom);
  return std::min(place, 2 * kRoom - place);
}

ImageView moved(const PatternPicture& picture, int frame) {
  return picture.from(toAndFro(2 * frame), toAndFro(frame / 2));
}

// The first frame, counted from `from`, that has all of `ids`; empty when none has.
std::optional<int> firstWith(const Run& run, std::size_t from, const std::set<int>& ids) {
  for (std::size_t k = from; k < run.found.size(); ++k) {
    if (std::ranges::includes(run.found[k], ids)) return static_cast<int>(k - from);
  }
  return std::nullopt;
}

int framesWithout(const Run& run, std::size_t from, int id) {
  return static_cast<int>(std::count_if(run.found.begin() + static_cast<std::ptrdiff_t>(from),
                                        run.found.end(),
                                        [id](const auto& found) { return !found.contains(id); }));
}

std::string framesText(const std::optional<int>& frames) {
  return frames ? std::to_string(*frames) : "never";
}

// Of `ids`, those that are found by looking at everything in the first frames: what lies before a
// pattern may be none to be found.
std::set<int> findable(const Runner& runner, const Frames& frames, const std::set<int>& ids) {
  constexpr int kFrames = 2;
  slam::FollowerOptions everything;
  everything.enabled = false;
  const Run run = runner.once(kFrames, everything, frames);
  std::set<int> found;
  std::ranges::copy_if(ids, std::inserter(found, found.end()),
                       [&](int id) { return framesWithout(run, 0, id) == 0; });
  return found;
}

bool runPattern(const PatternRunOptions& options, const NamedPattern& named,
                const Ordinary& ordinary) {
  const slam::CameraModel camera(calibration::roughCalibration(options.width, options.height));
  const Runner runner(options, camera);
  const auto picture = [&](std::span<const PlacedMarker> markers) {
    return PatternPicture(named.pattern, options.width, options.height, dictionary(), markers,
                          options.seed);
  };
  const PatternPicture empty = picture({});
  const PatternPicture some = picture(markersOf(options, false));
  const PatternPicture all = picture(markersOf(options, true));
  const Run lost = runner.run(options.frames, {}, [&](int k) { return moved(empty, k); });
  const Run first = runner.run(options.frames, {}, [&](int k) { return moved(all, k); });
  // Ones that are followed when others come into view.
  const int come = options.frames;
  const Run followed =
      runner.run(2 * options.frames, {}, [&](int k) { return moved(k < come ? some : all, k); });
  const std::set<int> there =
      findable(runner, [&](int k) { return moved(all, k); }, {3, 7, 11, 19});
  const auto found_first = firstWith(first, 0, there);
  const auto begun = firstWith(followed, 0, {3, 7});
  const auto found_new = firstWith(followed, static_cast<std::size_t>(come), there);
  const int lost_frames = begun ? framesWithout(followed, static_cast<std::size_t>(*begun), 3) +
                                      framesWithout(followed, static_cast<std::size_t>(*begun), 7)
                                : 2 * come;
  const double ordinary_ms = worst(ordinary.full_scans.cpu_ms);
  const double worst_ms = std::max(worst(lost.cpu_ms), worst(first.cpu_ms));
  const std::vector<double> after(followed.cpu_ms.begin() + begun.value_or(0) + 1,
                                  followed.cpu_ms.end());
  std::printf("%-9s %8.2f %8.2f %6.1f %10.2f %8.2f %6.1f %9zu %12s %10s %7d\n",
              std::string(named.name).c_str(), mean(lost.cpu_ms), worst_ms, worst_ms / ordinary_ms,
              mean(after), worst(after), worst(after) / ordinary_ms, there.size(),
              framesText(found_first).c_str(), framesText(found_new).c_str(), lost_frames);
  const auto most = static_cast<int>(kFindWithin_s * options.rate_hz);
  return std::max(worst_ms, worst(after)) <= kMostTimesOrdinary * ordinary_ms &&
         found_first.value_or(most + 1) <= most && found_new.value_or(most + 1) <= most &&
         lost_frames == 0;
}

}  // namespace

std::optional<bool> runPatterns(const PatternRunOptions& options) {
  const auto ordinary = runOrdinary(options);
  if (!ordinary) return std::nullopt;
  std::printf(
      "%dx%d, %d frames each; an ordinary one (walls) takes %.2f ms searched as a whole "
      "(worst %.2f), %.2f followed (worst %.2f)\n",
      options.width, options.height, options.frames, mean(ordinary->full_scans.cpu_ms),
      worst(ordinary->full_scans.cpu_ms), mean(ordinary->following.cpu_ms),
      worst(ordinary->following.cpu_ms));
  std::printf("%-9s %8s %8s %6s %10s %8s %6s %9s %12s %10s %7s\n", "", "in view", "worst", "times",
              "following", "worst", "times", "findable", "found after", "new after", "missed");
  bool within = true;
  for (const NamedPattern& named : kPatterns) {
    within = runPattern(options, named, *ordinary) && within;
  }
  return within;
}

}  // namespace waymark::bench
