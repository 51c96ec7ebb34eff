// Two pieces of the map that become one: does any frame take longer for it? A camera walks through
// one hall, is carried into another one in the dark, and then a door between them opens. Simulated
// corners, no images.
#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "base/clock.h"
#include "base/freed_memory.h"
#include "io/text/text_file.h"
#include "simulator/observed_corners.h"
#include "slam/slam.h"
#include "tests/bench/command_line.h"
#include "tests/bench/walk.h"
#include "tools/exit_code.h"
#include "tools/stage_timer.h"

namespace waymark::bench {
namespace {

struct Arguments {
  std::vector<int> sizes = {50, 200, 500};
  double rate_hz = 150.0;
  double sigma_px = 0.1;
  std::uint64_t seed = 1;
  int longest = 5;
  int runs = 3;
  std::size_t touched_mb = 600;
  std::string json_file;
};

// CPU time of the thread, of each stage of one frame, milliseconds.
class FrameWatch final : public slam::StageObserver {
 public:
  using Times = std::array<double, slam::kStages.size()>;

  void begin(slam::Stage /*stage*/) override { began_ns_ = threadCpuNs(); }
  void end(slam::Stage stage) override {
    times_ms_[static_cast<std::size_t>(stage)] += sinceMs(began_ns_);
  }
  static double sinceMs(std::int64_t began_ns) {
    return 1e-6 * static_cast<double>(threadCpuNs() - began_ns);
  }
  [[nodiscard]] Times take() { return std::exchange(times_ms_, {}); }

 private:
  std::int64_t began_ns_ = 0;
  Times times_ms_{};
};

struct MeasuredFrame {
  std::int64_t index = 0;
  double cpu_ms = 0.0;
  FrameWatch::Times stages_ms{};
  bool has_pose = false;
  bool keyframe = false;
};

// The frames of both pieces: before any showed markers of both, from the first of these to the one
// in which they are one, and from then on.
struct Measured {
  int markers_each = 0;
  int keyframes_stay = 0;  // of the older piece, which stays, when they were joined
  int keyframes_come = 0;
  std::vector<MeasuredFrame> before;
  std::vector<MeasuredFrame> joining;
  std::vector<MeasuredFrame> after;
  bool joined = false;
};

class Run {
 public:
  Run(const TwoHalls& halls, const Arguments& arguments)
      : halls_(halls),
        arguments_(arguments),
        camera_(halls.walk.camera),
        slam_(camera_, *slam::Dictionary::byName("4X4_1000"), optionsOf(halls.walk)) {}

  Measured measure(int markers_each) {
    Measured measured;
    measured.markers_each = markers_each;
    bool both = false;
    for (std::size_t k = 0; k < halls_.walk.frames.size(); ++k) {
      const Walk::Frame& frame = halls_.walk.frames[k];
      both = both || (k >= halls_.door_opens && showsBoth(frame, markers_each));
      noteSizes(&measured);
      const MeasuredFrame result = process(frame, static_cast<std::int64_t>(k));
      const bool was_joined = std::exchange(measured.joined, slam_.counters().pieces_joined > 0);
      // What begins a map, and is lost and found, is not what is compared.
      if (!both && 2 * k < halls_.door_opens) continue;
      (!both ? measured.before : !was_joined ? measured.joining : measured.after).push_back(result);
    }
    return measured;
  }

 private:
  static slam::Options optionsOf(const Walk& walk) {
    slam::Options options;
    options.markers.size_m = walk.marker_size_m;
    options.pieces.begin = true;
    return options;
  }
  static bool showsBoth(const Walk::Frame& frame, int markers_each) {
    const auto first = std::ranges::count_if(
        frame.in_view, [&](const simulator::Marker& marker) { return marker.id < markers_each; });
    return first > 0 && std::cmp_less(first, frame.in_view.size());
  }

  void noteSizes(Measured* measured) const {
    const std::vector<const slam::Map*> pieces = slam_.pieces();
    if (pieces.size() != 2) return;
    measured->keyframes_stay = static_cast<int>(pieces[0]->keyframes().size());
    measured->keyframes_come = static_cast<int>(pieces[1]->keyframes().size());
  }

  MeasuredFrame process(const Walk::Frame& frame, std::int64_t k) {
    const auto sequence = static_cast<std::uint64_t>(k);
    const auto time_ns =
        static_cast<std::int64_t>(1e9 * static_cast<double>(k) / halls_.walk.rate_hz);
    const auto detections =
        simulator::observeCorners(camera_, frame.T_w_c, frame.in_view, sequence,
                                  {.sigma_px = arguments_.sigma_px, .seed = arguments_.seed});
    const std::int64_t before_ns = threadCpuNs();
    const slam::FrameResult result =
        slam_.process({.time = {sequence, time_ns}, .detections = detections}, &watch_);
    MeasuredFrame measured{.index = k, .cpu_ms = FrameWatch::sinceMs(before_ns)};
    measured.stages_ms = watch_.take();
    measured.has_pose = result.pose.has_value();
    measured.keyframe = result.keyframe_added;
    return measured;
  }

  const TwoHalls& halls_;
  const Arguments& arguments_;
  slam::CameraModel camera_;
  slam::Slam slam_;
  FrameWatch watch_;
};

// Every run does the same work: what one has taken longer for is not of the program.
void takeLeast(const std::vector<MeasuredFrame>& again, std::vector<MeasuredFrame>* frames) {
  for (std::size_t i = 0; i < std::min(frames->size(), again.size()); ++i) {
    if (again[i].cpu_ms < (*frames)[i].cpu_ms) (*frames)[i] = again[i];
  }
}

Measured measure(int markers_each, const Arguments& arguments) {
  const TwoHalls halls = walkThroughTwoHalls(markers_each, arguments.rate_hz, arguments.seed);
  Measured least = Run(halls, arguments).measure(markers_each);
  for (int i = 1; i < arguments.runs; ++i) {
    const Measured again = Run(halls, arguments).measure(markers_each);
    takeLeast(again.before, &least.before);
    takeLeast(again.joining, &least.joining);
    takeLeast(again.after, &least.after);
  }
  return least;
}

double stageOf(const MeasuredFrame& frame, slam::Stage stage) {
  return frame.stages_ms[static_cast<std::size_t>(stage)];
}

double othersOf(const MeasuredFrame& frame) {
  double others_ms = frame.cpu_ms;
  for (const double stage_ms : frame.stages_ms) others_ms -= stage_ms;
  return others_ms;
}

nlohmann::ordered_json phase(const char* name, const std::vector<MeasuredFrame>& frames) {
  std::vector<double> cpu_ms;
  int posed = 0;
  MeasuredFrame longest;
  for (const MeasuredFrame& frame : frames) {
    cpu_ms.push_back(frame.cpu_ms);
    posed += frame.has_pose ? 1 : 0;
    if (frame.cpu_ms > longest.cpu_ms) longest = frame;
  }
  const tools::TimeSummary summary = tools::summarize(std::move(cpu_ms));
  return {{"phase", name},
          {"frames", frames.size()},
          {"with_pose", posed},
          {"mean_ms", summary.mean},
          {"p99_ms", summary.p99},
          {"max_ms", summary.max},
          {"longest",
           {{"frame", longest.index},
            {"track_ms", stageOf(longest, slam::Stage::kTrack)},
            {"map_ms", stageOf(longest, slam::Stage::kMap)},
            {"others_ms", othersOf(longest)}}}};
}

nlohmann::ordered_json report(const Measured& measured) {
  return {{"markers_each", measured.markers_each},
          {"keyframes", {measured.keyframes_stay, measured.keyframes_come}},
          {"joined", measured.joined},
          {"phases",
           {phase("before", measured.before), phase("joining", measured.joining),
            phase("after", measured.after)}}};
}

void print(const nlohmann::ordered_json& report) {
  std::printf("%d markers each, %d and %d keyframes%s\n", report["markers_each"].get<int>(),
              report["keyframes"][0].get<int>(), report["keyframes"][1].get<int>(),
              report["joined"].get<bool>() ? "" : ", not joined");
  std::printf("  %-8s %7s %9s %8s %8s %8s   %s\n", "", "frames", "with pose", "mean ms", "p99 ms",
              "max ms", "of the longest: track / map / others ms");
  for (const auto& phase : report["phases"]) {
    const auto& longest = phase["longest"];
    std::printf("  %-8s %7d %9d %8.4f %8.4f %8.4f   %.3f / %.3f / %.3f\n",
                phase["phase"].get<std::string>().c_str(), phase["frames"].get<int>(),
                phase["with_pose"].get<int>(), phase["mean_ms"].get<double>(),
                phase["p99_ms"].get<double>(), phase["max_ms"].get<double>(),
                longest["track_ms"].get<double>(), longest["map_ms"].get<double>(),
                longest["others_ms"].get<double>());
  }
}

// By how long they took, with where they are from the frame that joined the two.
void printLongest(const Measured& measured, int count) {
  std::vector<MeasuredFrame> frames = measured.joining;
  const std::int64_t joined = frames.empty() ? 0 : frames.back().index;
  frames.insert(frames.end(), measured.after.begin(), measured.after.end());
  std::ranges::sort(frames, std::ranges::greater(), &MeasuredFrame::cpu_ms);
  frames.resize(std::min(frames.size(), static_cast<std::size_t>(count)));
  for (const MeasuredFrame& frame : frames) {
    std::printf("    %+6lld frames from the joint: %.3f ms, track %.3f, map %.3f, others %.3f%s\n",
                static_cast<long long>(frame.index - joined), frame.cpu_ms,
                stageOf(frame, slam::Stage::kTrack), stageOf(frame, slam::Stage::kMap),
                othersOf(frame), frame.keyframe ? ", a keyframe" : "");
  }
}

// Where the host of a virtual machine gives memory page by page, touching a new one takes some 15
// us, and frames that need much of it for the first time take milliseconds for nothing but that.
// All of it is touched beforehand, and kept.
void touchMemory(std::size_t megabytes) {
  constexpr std::size_t kBlock = 1024 * 1024;
  constexpr std::size_t kPage = 4096;
  std::vector<std::unique_ptr<std::byte[]>> blocks;
  for (std::size_t i = 0; i < megabytes; ++i) {
    blocks.push_back(std::make_unique_for_overwrite<std::byte[]>(kBlock));
    for (std::size_t k = 0; k < kBlock; k += kPage) blocks.back()[k] = std::byte{1};
  }
}

tools::ExitCode run(const Arguments& arguments) {
  keepFreedMemory();  // as the daemon does
  touchMemory(arguments.touched_mb);
  nlohmann::ordered_json all = nlohmann::ordered_json::array();
  bool joined = true;
  for (const int size : arguments.sizes) {
    const Measured measured = measure(size, arguments);
    all.push_back(report(measured));
    print(all.back());
    printLongest(measured, arguments.longest);
    std::fflush(stdout);
    joined = joined && measured.joined;
  }
  if (!arguments.json_file.empty()) {
    const Status written = io::writeTextFile(arguments.json_file, all.dump(1) + "\n");
    if (!written) return exitCodeOf("piece_join", written);
  }
  return joined ? tools::kDone : tools::kNoPose;
}

}  // namespace
}  // namespace waymark::bench

int main(int argc, char** argv) {
  using namespace waymark;
  bench::Arguments arguments;
  CLI::App app{"What the frames take in which two pieces of the map become one", "piece_join"};
  app.add_option("sizes", arguments.sizes, "Markers of each piece")
      ->capture_default_str()
      ->check(CLI::Range(20, 500));
  app.add_option("--rate", arguments.rate_hz, "Frames a second")
      ->capture_default_str()
      ->check(CLI::PositiveNumber);
  app.add_option("--seed", arguments.seed)->capture_default_str();
  app.add_option("--sigma", arguments.sigma_px, "Noise of the corners, pixels")
      ->capture_default_str()
      ->check(CLI::PositiveNumber);
  app.add_option("--longest", arguments.longest, "So many of the longest frames are told")
      ->capture_default_str()
      ->check(CLI::NonNegativeNumber);
  app.add_option("--runs", arguments.runs, "Of each size; what a frame took least is told")
      ->capture_default_str()
      ->check(CLI::PositiveNumber);
  app.add_option("--touch", arguments.touched_mb, "Memory that is touched beforehand, MB")
      ->capture_default_str();
  app.add_option("--json", arguments.json_file, "All of it as JSON, to this file");
  if (const auto exit_code = bench::parse(app, argc, argv)) return *exit_code;
  return bench::run(arguments);
}
