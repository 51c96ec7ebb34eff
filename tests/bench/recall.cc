// How many markers detectors find, by the length of their sides, blur, noise and tilt: single
// markers on paper (simulator/testing/marker_photo.h), ours beside those of Debian's OpenCV and
// AprilTag. And of ours, whether corners and covariance tell the truth.
//
//   recall [--repeats N] [--alone] [--json FILE] [--svg FILE]
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>
#include <Eigen/LU>

#include "io/text/json_node.h"
#include "io/text/text_file.h"
#include "simulator/random.h"
#include "simulator/testing/marker_photo.h"
#include "slam/detection/marker_detector.h"
#include "tests/bench/command_line.h"
#include "tests/bench/peers.h"
#include "tests/bench/recall_figure.h"
#include "tools/exit_code.h"

namespace waymark::bench {
namespace {

using simulator::testing::MarkerPhoto;

struct Arguments {
  std::vector<double> sides_px = {7,  8,   10,  12,  16,  24,  32,  48,
                                  64, 100, 150, 200, 280, 400, 560, 800};
  std::vector<double> blurs_px = {0.5, 1, 1.5, 2, 3, 4, 6, 8};
  std::vector<double> noise_sigmas = {2, 5, 10};
  std::vector<double> tilts_deg = {0, 30, 60};
  int repeats = 4;
  std::uint64_t seed = 1;
  bool alone = false;
  std::string json, svg;
};

// What became of the photographs of one kind.
struct Kind {
  double side_px = 0.0, blur_px = 0.0, noise_sigma = 0.0, tilt_deg = 0.0;
  int photos = 0;
  std::vector<int> found;  // by detector
  // Of our corners.
  int corners = 0;
  double squared_px2 = 0.0;  // sum over the coordinates
  double chi2 = 0.0;         // sum of squared errors in units of their covariance
};

bool isNear(const ImageCorners& found, const ImageCorners& truth, double side_px) {
  double farthest = 0.0;
  for (std::size_t k = 0; k < 4; ++k) farthest = std::max(farthest, (found[k] - truth[k]).norm());
  return farthest < std::max(3.0, 0.1 * side_px);
}

class Bench {
 public:
  explicit Bench(const Arguments& arguments)
      : arguments_(arguments), dictionary_(*slam::Dictionary::byName("APRILTAG_36h11")) {
    names_.emplace_back("waymark");
    if (arguments.alone) return;
    peers_.push_back(openCvDetector());
    peers_.push_back(aprilTagDetector());
    for (const auto& peer : peers_) names_.push_back(peer->name());
  }

  void run() {
    for (const double side_px : arguments_.sides_px) {
      for (const double blur_px : arguments_.blurs_px) {
        for (const double noise_sigma : arguments_.noise_sigmas) {
          for (const double tilt_deg : arguments_.tilts_deg) {
            kinds_.push_back({.side_px = side_px,
                              .blur_px = blur_px,
                              .noise_sigma = noise_sigma,
                              .tilt_deg = tilt_deg,
                              .found = std::vector<int>(names_.size(), 0)});
            for (int i = 0; i < arguments_.repeats; ++i) photograph(i, &kinds_.back());
          }
        }
      }
    }
  }

  void print() const {
    for (std::size_t d = 0; d < names_.size(); ++d) {
      for (const double noise_sigma : arguments_.noise_sigmas) {
        std::printf("%s, noise of %g grey levels: %% found\n", names_[d].c_str(), noise_sigma);
        printTable([&](double side_px, double blur_px) {
          return recallPercent(d, side_px, blur_px, noise_sigma);
        });
      }
    }
    std::printf("waymark: mean squared error of a corner in units of its covariance\n");
    printTable([&](double side_px, double blur_px) {
      const Kind sum = ours(side_px, blur_px);
      return sum.corners == 0 ? -1.0 : sum.chi2 / (2.0 * sum.corners);
    });
    std::printf("waymark: RMS of a corner's coordinate, pixels\n");
    printTable([&](double side_px, double blur_px) {
      const Kind sum = ours(side_px, blur_px);
      return sum.corners == 0 ? -1.0 : std::sqrt(sum.squared_px2 / (2.0 * sum.corners));
    });
    std::printf("%-14s %9s %9s %9s %9s %9s\n", "all", "found", "0 deg", "30 deg", "60 deg",
                "wrong");
    for (std::size_t d = 0; d < names_.size(); ++d) {
      std::printf("%-14s %8.2f%%", names_[d].c_str(),
                  recallPercent(d, [](const Kind&) { return true; }));
      for (const double tilt_deg : arguments_.tilts_deg) {
        std::printf(" %8.2f%%",
                    recallPercent(d, [&](const Kind& kind) { return kind.tilt_deg == tilt_deg; }));
      }
      std::printf(" %9d\n", wrong_[d]);
    }
  }

  [[nodiscard]] Status write() const {
    if (!arguments_.json.empty()) {
      io::Json kinds = io::Json::array();
      for (const Kind& kind : kinds_) {
        io::Json one = {{"side_px", kind.side_px},
                        {"blur_px", kind.blur_px},
                        {"noise_sigma", kind.noise_sigma},
                        {"tilt_deg", kind.tilt_deg},
                        {"photos", kind.photos},
                        {"corners", kind.corners},
                        {"chi2", kind.chi2},
                        {"squared_px2", kind.squared_px2}};
        for (std::size_t d = 0; d < names_.size(); ++d) one["found"][names_[d]] = kind.found[d];
        kinds.push_back(std::move(one));
      }
      const Status written = io::writeTextFile(arguments_.json, kinds.dump(1) + "\n");
      if (!written) return written;
    }
    if (arguments_.svg.empty()) return success();
    return io::writeTextFile(arguments_.svg, figure());
  }

 private:
  void photograph(int number, Kind* kind) {
    const std::uint64_t seed = arguments_.seed + ++photos_;
    const int id = static_cast<int>(simulator::Random(seed, 1).next() %
                                    static_cast<std::uint64_t>(dictionary_.size()));
    // On paper that stands out from a darker wall, or from a lighter one.
    const double wall = number % 2 == 0 ? 120.0 : 190.0;
    const MarkerPhoto photo(dictionary_, {.id = id,
                                          .side_px = kind->side_px,
                                          .tilt_deg = kind->tilt_deg,
                                          .blur_px = kind->blur_px,
                                          .noise_sigma = kind->noise_sigma,
                                          .wall = wall,
                                          .seed = seed});
    ++kind->photos;
    slam::MarkerDetector detector(photo.camera(), dictionary_);
    std::map<int, ImageCorners> found;
    for (const auto& seen : detector.detect(photo.image())) {
      found[seen.id] = seen.pixels;
      if (seen.id == id && isNear(seen.pixels, photo.corners(), kind->side_px)) {
        addErrors(seen, photo, kind);
      }
    }
    count(0, found, id, photo, kind);
    for (std::size_t i = 0; i < peers_.size(); ++i) {
      count(i + 1, peers_[i]->detect(photo.image()), id, photo, kind);
    }
  }

  void count(std::size_t detector, const std::map<int, ImageCorners>& found, int id,
             const MarkerPhoto& photo, Kind* kind) {
    for (const auto& [found_id, corners] : found) {
      const bool right = found_id == id && isNear(corners, photo.corners(), kind->side_px);
      (right ? kind->found : wrong_)[detector] += 1;
    }
  }

  static void addErrors(const slam::MarkerDetection& seen, const MarkerPhoto& photo, Kind* kind) {
    const ImageCorners truth = photo.corners();
    for (std::size_t k = 0; k < 4; ++k) {
      const auto normalized = photo.camera().undistort(truth[k]);
      if (!normalized) continue;
      const Eigen::Vector2d error = seen.normalized[k] - *normalized;
      kind->squared_px2 += (seen.pixels[k] - truth[k]).squaredNorm();
      kind->chi2 += error.dot(seen.covariance[k].inverse() * error);
      ++kind->corners;
    }
  }

  template <typename Counts>
  [[nodiscard]] double recallPercent(std::size_t detector, const Counts& counts) const {
    int found = 0;
    int photos = 0;
    for (const Kind& kind : kinds_) {
      if (!counts(kind)) continue;
      found += kind.found[detector];
      photos += kind.photos;
    }
    return 100.0 * found / std::max(photos, 1);
  }

  [[nodiscard]] double recallPercent(std::size_t detector, double side_px, double blur_px,
                                     double noise_sigma) const {
    return recallPercent(detector, [&](const Kind& kind) {
      return kind.side_px == side_px && kind.blur_px == blur_px && kind.noise_sigma == noise_sigma;
    });
  }

  [[nodiscard]] Kind ours(double side_px, double blur_px) const {
    Kind sum;
    for (const Kind& kind : kinds_) {
      if (kind.side_px != side_px || kind.blur_px != blur_px) continue;
      sum.corners += kind.corners;
      sum.squared_px2 += kind.squared_px2;
      sum.chi2 += kind.chi2;
    }
    return sum;
  }

  // value(side, blur); nothing where it is negative.
  template <typename Value>
  void printTable(const Value& value) const {
    std::printf("%9s", "blur\\side");
    for (const double side_px : arguments_.sides_px) std::printf(" %5g", side_px);
    std::printf("\n");
    for (const double blur_px : arguments_.blurs_px) {
      std::printf("%9g", blur_px);
      for (const double side_px : arguments_.sides_px) {
        const double v = value(side_px, blur_px);
        if (v < 0.0) {
          std::printf(" %5s", "");
        } else {
          std::printf(v < 10.0 && v != std::floor(v) ? " %5.2f" : " %5.0f", v);
        }
      }
      std::printf("\n");
    }
  }

  [[nodiscard]] std::string figure() const {
    std::vector<RecallPanel> panels;
    for (const double noise_sigma : arguments_.noise_sigmas) {
      for (std::size_t d = 0; d < names_.size(); ++d) {
        RecallPanel panel{.detector = names_[d], .noise_sigma = noise_sigma, .percent = {}};
        for (const double blur_px : arguments_.blurs_px) {
          for (const double side_px : arguments_.sides_px) {
            panel.percent.push_back(recallPercent(d, side_px, blur_px, noise_sigma));
          }
        }
        panels.push_back(std::move(panel));
      }
    }
    return recallFigure(panels, arguments_.sides_px, arguments_.blurs_px);
  }

  const Arguments& arguments_;
  slam::Dictionary dictionary_;
  std::vector<std::string> names_;
  std::vector<std::unique_ptr<Detector>> peers_;
  std::vector<Kind> kinds_;
  std::vector<int> wrong_ = std::vector<int>(3, 0);
  std::uint64_t photos_ = 0;
};

tools::ExitCode run(const Arguments& arguments) {
  Bench bench(arguments);
  bench.run();
  bench.print();
  return exitCodeOf("recall", bench.write());
}

}  // namespace
}  // namespace waymark::bench

int main(int argc, char** argv) {
  using namespace waymark;
  bench::Arguments arguments;
  CLI::App app{"Recall by side, blur, noise and tilt", "recall"};
  app.add_option("--sides", arguments.sides_px, "Of the marker, pixels")
      ->check(CLI::PositiveNumber);
  app.add_option("--blurs", arguments.blurs_px, "Standard deviations, pixels")
      ->check(CLI::PositiveNumber);
  app.add_option("--noise", arguments.noise_sigmas, "Grey levels")->check(CLI::NonNegativeNumber);
  app.add_option("--tilts", arguments.tilts_deg, "Degrees")->check(CLI::Range(0.0, 80.0));
  app.add_option("--repeats", arguments.repeats, "Photographs of each kind")
      ->capture_default_str()
      ->check(CLI::PositiveNumber);
  app.add_option("--seed", arguments.seed)->capture_default_str();
  app.add_flag("--alone", arguments.alone, "Our detector only");
  app.add_option("--json", arguments.json, "What was counted into this file");
  app.add_option("--svg", arguments.svg, "A figure into this file");
  if (const auto exit_code = bench::parse(app, argc, argv)) return *exit_code;
  return bench::run(arguments);
}
