#include "slam/detection/marker_detector.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "slam/geometry/plane.h"
#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

Eigen::Vector2d centre(const MarkerDetection& d) { return centreOf(d.pixels); }
double diagonalOf(const Quad& quad) { return (quad[2] - quad[0]).norm(); }

double diagonal(const MarkerDetection& d) { return diagonalOf(d.pixels); }

constexpr std::size_t kMaxRejected = 256;  // what memory is taken for

constexpr int kUnlimited = ScanBudget::kUnlimited;

bool isPart(const Window& window, const ImageView& image) {
  return window.width < image.width || window.height < image.height;
}

void spend(int what, int* left) {
  if (*left != kUnlimited) *left = std::max(*left - what, 0);
}

int shareOf(int left, double share, int least) {
  if (left == kUnlimited) return kUnlimited;
  return std::max(static_cast<int>(share * left), least);
}

}  // namespace

std::string DetectorOptions::invalidReason() const {
  return firstReason({
      scanner.invalidReason(),
      edges.invalidReason(),
      soft.invalidReason(),
      decoder.invalidReason(),
      budget.invalidReason(),
      firstUnmet({
          {rejected_frames >= 0, "the frames of a rejected square must not be negative"},
          {isNotNegative(same_rejected),
           "the share of a same rejected square must not be negative"},
          {isNotNegative(entering_px), "the margin of what enters must not be negative"},
          {isNotNegative(min_reduced_diagonal_px),
           "the shortest reduced diagonal must not be negative"},
          {isNotNegative(readable_cell_px), "the size of a readable cell must not be negative"},
          {reduced_margin_px >= 0, "the margin of a reduced square must not be negative"},
          {isPositive(known_centre) && isPositive(min_known_size) &&
               max_known_size >= min_known_size,
           "a known square's share and factors must be positive"},
          {whole_reduced == 0 || whole_reduced == 2 || whole_reduced == 4,
           "whole images can be searched at 1/2 or 1/4 of their size, too, or not at all"},
          {isNotNegative(same_place), "the share of a same place must not be negative"},
      }),
  });
}

MarkerDetector::MarkerDetector(const CameraModel& camera, Dictionary dictionary,
                               const DetectorOptions& options)
    : camera_(camera),
      options_(options),
      dictionary_(std::move(dictionary)),
      scanner_(options.scanner, options.budget),
      decoder_(camera_, dictionary_, options.decoder),
      measurer_(camera_, dictionary_, &decoder_, options.edges, options.soft),
      picker_(options.budget.turn_share) {
  rejected_.reserve(kMaxRejected);
}

const std::vector<MarkerDetection>& MarkerDetector::detect(const ImageView& image) {
  begin();
  left_ = {};
  (void)scanAll(image);
  return finish();
}

void MarkerDetector::begin() {
  measured_.clear();
  detections_.clear();
  left_ = budget_;
  std::erase_if(rejected_, [this](Rejected& rejected) {
    return ++rejected.frames > options_.rejected_frames;
  });
}

bool MarkerDetector::confirm(const ImageView& image, int id,
                             const std::array<Eigen::Vector2d, 4>& corners,
                             const MeasuredMarker* before) {
  // What never was there costs as little as a look.
  if (before == nullptr && decoder_.read(image, corners).content == QuadContent::kNothing) {
    return false;
  }
  // Where edges were soft they may be sharp again.
  const bool was_soft = before != nullptr && before->factor > 1;
  const SideFits* const edges = before == nullptr || was_soft ? nullptr : &before->edges;
  auto measured = counted(measurer_.measure(image, id, corners, edges));
  if (!measured) measured = measurer_.readSoft(image, corners);
  if (!measured || measured->detection.id != id) return false;
  measured_.push_back(*measured);
  return true;
}

// At the reduced size when it is its turn: what is no marker there is not looked at again so soon.
ScanOutcome MarkerDetector::scanAll(const ImageView& image, std::uint32_t turn) {
  const Window whole{0, 0, image.width, image.height};
  const ScanOutcome outcome = scan(image, {.window = whole, .turn = turn});
  const bool is_due = turn % static_cast<std::uint32_t>(options_.rejected_frames + 1) == 0;
  if (outcome == ScanOutcome::kDone && options_.whole_reduced > 1 && is_due) {
    (void)scan(image, {.window = whole, .factor = options_.whole_reduced, .turn = turn});
  }
  return outcome;
}

ScanOutcome MarkerDetector::scan(const ImageView& image, const SearchRegion& region, double share,
                                 Runs runs) {
  const ScanBudget allowed = allotment(share, runs, runs == Runs::kBounded);
  return region.factor == 1 ? scanWhole(image, region, allowed)
                            : scanReduced(image, region, allowed);
}

ScanBudget MarkerDetector::allotment(double share, Runs runs, bool first_come) const {
  const ScanBudgetOptions& options = options_.budget;
  const int fits = shareOf(left_.futile_fits, share, options.least_fits);
  const double first_come_share = first_come || fits == kUnlimited ? options.first_come_share : 0.0;
  return {runs == Runs::kUnbounded ? kUnlimited : left_.runs,
          shareOf(left_.regions, share, options.least_regions),
          shareOf(left_.candidates, share, options.least_candidates), fits,
          shareOf(fits, first_come_share, 0)};
}

const std::vector<MarkerDetection>& MarkerDetector::finish() {
  for (const MeasuredMarker& measured : measured_) detections_.push_back(measured.detection);
  mergeOutlines();
  return detections_;
}

// image: the region at the size it is searched at.
QuadScan MarkerDetector::scanForQuads(const ImageView& image, const SearchRegion& region,
                                      const ScanBudget& allowed) {
  if (observer_ != nullptr) observer_->advance();
  const QuadScan scan = scanner_.scan(image, region.max_px, allowed, region.turn);
  if (!scan.too_busy) spend(scan.runs, &left_.runs);
  spend(scan.regions, &left_.regions);
  work_.regions += static_cast<std::uint64_t>(scan.regions);
  work_.compared += static_cast<std::uint64_t>(scan.compared);
  work_.deferred += static_cast<std::uint64_t>(scan.deferred_regions);
  promise_.assign(scan.promise.begin(), scan.promise.end());
  return scan;
}

void MarkerDetector::deferCandidates(int most, std::uint32_t turn) {
  const std::span<const std::uint32_t> picked = picker_.pick(promise_, most, turn);
  work_.deferred += candidates_.size() - picked.size();
  for (std::size_t i = 0; i < picked.size(); ++i) {
    candidates_[i] = candidates_[picked[i]];
    promise_[i] = promise_[picked[i]];
  }
  candidates_.resize(picked.size());
  promise_.resize(picked.size());
}

void MarkerDetector::countCandidate() {
  if (observer_ != nullptr) observer_->advance();
  spend(1, &left_.candidates);
  ++work_.candidates;
}

void MarkerDetector::countFutileFit() {
  spend(1, &left_.futile_fits);
  ++work_.futile_fits;
}

ScanOutcome MarkerDetector::scanWhole(const ImageView& image, const SearchRegion& region,
                                      const ScanBudget& allowed) {
  const Window& window = region.window;
  const std::uint64_t deferred = work_.deferred;
  const bool in_turn = isPart(window, image);
  const QuadScan scan = scanForQuads(partOf(image, window), region, allowed);
  counters_.quads += scan.quads.size();
  const bool too_many = scan.quads.size() > static_cast<std::size_t>(allowed.candidates);
  candidates_.clear();
  for (std::size_t i = 0; i < scan.quads.size(); ++i) {
    Quad quad = scan.quads[i];
    for (Eigen::Vector2d& corner : quad) corner += Eigen::Vector2d(window.left, window.top);
    // Where not all can be looked at, none is looked at again.
    if (too_many && isKnown(quad)) {
      ++counters_.merged;
      continue;
    }
    if (too_many && in_turn && wasRejected(quad)) {
      ++counters_.rejected;
      continue;
    }
    promise_[candidates_.size()] = promise_[i];
    candidates_.push_back(quad);
  }
  promise_.resize(candidates_.size());
  if (too_many) deferCandidates(allowed.candidates, region.turn);
  examineAll(image, region, allowed);
  return outcomeOf(scan, deferred, allowed);
}

void MarkerDetector::examineAll(const ImageView& image, const SearchRegion& region,
                                const ScanBudget& allowed) {
  const bool in_turn = isPart(region.window, image);
  const auto first_come = static_cast<std::uint64_t>(allowed.first_come_fits);
  const std::uint64_t fits = work_.futile_fits;
  unclear_.clear();
  for (std::size_t i = 0; i < candidates_.size(); ++i) {
    const Quad& quad = candidates_[i];
    if (isKnown(quad)) {
      ++counters_.merged;
    } else if (in_turn && wasRejected(quad)) {
      ++counters_.rejected;
    } else {
      examine(image, quad, promise_[i], work_.futile_fits - fits < first_come);
    }
  }
  if (unclear_.empty()) return;
  fitUnclear(image, allowed.futile_fits - static_cast<int>(work_.futile_fits - fits), region.turn);
}

// Much more in later frames than in this one: better each part in its turn.
ScanOutcome MarkerDetector::outcomeOf(const QuadScan& scan, std::uint64_t deferred_before,
                                      const ScanBudget& allowed) const {
  const std::uint64_t deferred = work_.deferred - deferred_before;
  const bool too_busy = scan.too_busy || deferred > static_cast<std::uint64_t>(allowed.candidates);
  return too_busy ? ScanOutcome::kTooBusy : ScanOutcome::kDone;
}

// What may be a marker there is looked at where it is in the image itself.
ScanOutcome MarkerDetector::scanReduced(const ImageView& image, const SearchRegion& region,
                                        const ScanBudget& allowed) {
  const Window& window = region.window;
  const int factor = region.factor;
  const std::uint64_t deferred = work_.deferred;
  const QuadScan scan =
      scanForQuads(reducer_.reduce(partOf(image, window), factor), region, allowed);
  candidates_.clear();
  for (std::size_t i = 0; i < scan.quads.size(); ++i) {
    Quad quad = scan.quads[i];
    // The middle of a reduced pixel is in the middle of those it was made of.
    for (Eigen::Vector2d& corner : quad) {
      corner = factor * corner + Eigen::Vector2d(window.left, window.top) +
               Eigen::Vector2d::Constant(0.5 * (factor - 1));
    }
    // Smaller ones are found at a larger size.
    if (factor > 2 && diagonalOf(quad) < options_.min_reduced_diagonal_px * factor) continue;
    if (isKnown(quad) || wasRejected(quad)) continue;
    promise_[candidates_.size()] = promise_[i];
    candidates_.push_back(quad);
  }
  promise_.resize(candidates_.size());
  if (candidates_.size() > static_cast<std::size_t>(allowed.candidates)) {
    deferCandidates(allowed.candidates, region.turn);
  }
  std::swap(reduced_candidates_, candidates_);
  const std::uint64_t looked_at = work_.candidates;
  const std::uint64_t fits = work_.futile_fits;
  for (std::size_t i = 0; i < reduced_candidates_.size(); ++i) {
    const Quad& quad = reduced_candidates_[i];
    // The searches around them spend, too. What is left now comes first while these are rejected.
    if (work_.candidates - looked_at >= static_cast<std::uint64_t>(allowed.candidates) ||
        work_.futile_fits - fits >= static_cast<std::uint64_t>(allowed.futile_fits)) {
      work_.deferred += reduced_candidates_.size() - i;
      break;
    }
    const auto corners = undistortCorners(camera_, quad);
    if (!corners) continue;
    countCandidate();
    const QuadContent content = decoder_.read(image, *corners).content;
    const bool unreadable =
        diagonalOf(quad) < options_.readable_cell_px * factor * dictionary_.cells();
    if (content == QuadContent::kNothing || (content == QuadContent::kNoCode && !unreadable)) {
      reject(quad);
      continue;
    }
    const std::size_t before = measured_.size();
    const Window around = windowAround(quad, options_.reduced_margin_px + factor, image);
    (void)scanWhole(image, {.window = around, .turn = region.turn},
                    allotment(0.0, Runs::kUnbounded, allowed.first_come_fits > 0));
    if (measured_.size() > before) continue;
    if (const auto soft = measurer_.readSoft(image, *corners)) {
      measured_.push_back(*soft);
      continue;
    }
    countFutileFit();
    reject(quad);
  }
  return outcomeOf(scan, deferred, allowed);
}

bool MarkerDetector::wasRejected(const Quad& quad) {
  const Eigen::Vector2d centre = centreOf(quad);
  const double diagonal = diagonalOf(quad);
  const auto known = std::ranges::find_if(rejected_, [&](const Rejected& rejected) {
    return std::abs(rejected.diagonal - diagonal) < options_.same_rejected * diagonal &&
           (rejected.centre - centre).norm() < options_.same_rejected * diagonal;
  });
  if (known == rejected_.end()) return false;
  known->centre = centre;
  return true;
}

// What is only just coming into view may be a marker in the next frame.
void MarkerDetector::reject(const Quad& quad) {
  const bool inside = std::ranges::all_of(quad, [&](const Eigen::Vector2d& corner) {
    return camera_.inImage(corner, options_.entering_px);
  });
  if (inside && rejected_.size() < kMaxRejected)
    rejected_.push_back({centreOf(quad), diagonalOf(quad), 0});
}

// Most codes can be read with the corners as they were found, and most of what is no marker looks
// like none: exact corners are for markers. Small ones are read with better corners; `may_fit`:
// now, else they wait in unclear_.
void MarkerDetector::examine(const ImageView& image, const Quad& quad, float promise,
                             bool may_fit) {
  countCandidate();
  const auto corners = undistortCorners(camera_, quad);
  if (!corners) {
    ++counters_.no_edge;
    return reject(quad);
  }
  const QuadReading reading = decoder_.read(image, *corners);
  switch (reading.content) {
    case QuadContent::kNothing:
      ++counters_.no_code;
      return reject(quad);
    case QuadContent::kMarker: {
      const auto measured = counted(measurer_.measure(
          image, reading.match.id, turnedUpright(*corners, reading.match.rotation), nullptr));
      return keep(quad, measured ? measured : measurer_.readSoft(image, *corners));
    }
    case QuadContent::kNoCode:
      break;
  }
  if (may_fit) return keep(quad, readWithEdges(image, *corners));
  const double half = 0.5 * dictionary_.side() * dictionary_.side();
  const double likeness = reading.code
                              ? std::max(1.0 - dictionary_.distanceTo(*reading.code) / half, 0.0)
                              : options_.budget.rough_border_likeness;
  unclear_.push_back({quad, *corners, promise * static_cast<float>(likeness)});
}

void MarkerDetector::fitUnclear(const ImageView& image, int most, std::uint32_t turn) {
  promise_.clear();
  for (const Unclear& unclear : unclear_) promise_.push_back(unclear.promise);
  const std::span<const std::uint32_t> picked = picker_.pick(promise_, most, turn);
  work_.deferred += unclear_.size() - picked.size();
  for (const std::uint32_t i : picked) {
    const Unclear& unclear = unclear_[i];
    if (isKnown(unclear.quad)) {
      ++counters_.merged;
    } else {
      keep(unclear.quad, readWithEdges(image, unclear.corners));
    }
  }
}

std::optional<MeasuredMarker> MarkerDetector::readWithEdges(
    const ImageView& image, const std::array<Eigen::Vector2d, 4>& corners) {
  auto measured = counted(measurer_.read(image, corners));
  if (!measured) measured = measurer_.readSoft(image, corners);
  if (!measured) countFutileFit();
  return measured;
}

std::optional<MeasuredMarker> MarkerDetector::counted(const Measurement& measurement) {
  if (measurement.is_unlike) {
    ++counters_.unlike;
  } else if (!measurement.marker) {
    ++(measurement.has_edges ? counters_.no_code : counters_.no_edge);
  }
  return measurement.marker;
}

void MarkerDetector::keep(const Quad& quad, const std::optional<MeasuredMarker>& measured) {
  if (measured) {
    measured_.push_back(*measured);
  } else {
    reject(quad);
  }
}

// The same marker found with another threshold.
bool MarkerDetector::isKnown(const Quad& quad) const {
  const Eigen::Vector2d middle = centreOf(quad);
  const double size = (quad[2] - quad[0]).norm() + (quad[3] - quad[1]).norm();
  return std::ranges::any_of(measured_, [&](const MeasuredMarker& measured) {
    const MarkerDetection& known = measured.detection;
    const double known_size = diagonal(known) + (known.pixels[3] - known.pixels[1]).norm();
    return (centre(known) - middle).norm() < options_.known_centre * known_size &&
           size > options_.min_known_size * known_size &&
           size < options_.max_known_size * known_size;
  });
}

// Of the outlines of one border, the outermost stays. Two prints of one id both stay: who uses them
// decides what that means.
void MarkerDetector::mergeOutlines() {
  std::sort(detections_.begin(), detections_.end(),
            [](const MarkerDetection& a, const MarkerDetection& b) {
              if (a.id != b.id) return a.id < b.id;
              return diagonal(a) > diagonal(b);
            });
  auto kept = detections_.begin();  // where those that stay end
  for (auto next = detections_.begin(); next != detections_.end(); ++next) {
    const bool merged = std::any_of(detections_.begin(), kept, [&](const MarkerDetection& other) {
      return other.id == next->id &&
             (centre(*next) - centre(other)).norm() < options_.same_place * diagonal(other);
    });
    if (merged) {
      ++counters_.merged;
    } else {
      *kept++ = *next;
    }
  }
  detections_.erase(kept, detections_.end());
}

}  // namespace waymark::slam
