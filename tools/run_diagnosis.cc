#include "tools/run_diagnosis.h"

#include <algorithm>
#include <span>
#include <vector>

#include "base/quantile.h"

namespace waymark::tools {
namespace {

diagnosis::RunFacts factsOf(const RunRecord& record, const slam::Slam& slam,
                            const slam::Options& options, const std::string& dictionary) {
  diagnosis::RunFacts facts{.dictionary = dictionary,
                            .marker_size_m = options.markers.size_m,
                            .focal_px = slam.camera().focalLength(),
                            .frames = record.frames(),
                            .localized = record.localized()};
  std::vector<double> sides_px;
  for (const slam::LiveFrame& frame : record.keptFrames()) {
    if (!frame.detections.empty()) ++facts.frames_with_markers;
    for (const slam::MarkerDetection& marker : frame.detections) {
      ++facts.markers_seen;
      ++facts.seen_by_id[marker.id];
      sides_px.push_back((marker.pixels[1] - marker.pixels[0]).norm());
    }
  }
  if (!sides_px.empty()) {
    std::ranges::sort(sides_px);
    facts.median_side_px = quantile(std::span<const double>(sides_px), 500);
  }
  facts.rejected_markers = slam.counters().rejected_markers;
  facts.rms_px = record.reprojectionRms_px();
  facts.quads = slam.counters().quads;
  facts.lens_given = options.lens.given;
  const slam::LensKnowledge& lens = slam.lens();
  if (!facts.lens_given && lens.state == slam::LensState::kLearning) {
    facts.lens_open_share = lens.focalShare();
  }
  for (const auto& [reason, count] : record.reasons()) {
    facts.reasons[slam::describe(reason)] = count;
  }
  return facts;
}

}  // namespace

diagnosis::Verdict judgeRun(const RunRecord& record, const slam::Slam& slam,
                            const slam::Options& options, const std::string& dictionary,
                            const diagnosis::ImageSamples& samples) {
  diagnosis::RunFacts facts = factsOf(record, slam, options, dictionary);
  facts.own_corners = !samples.images().empty();
  if (diagnosis::wantsImages(facts) && !samples.images().empty()) {
    facts.images = diagnosis::lookAt(samples.images(), dictionary, slam.camera());
  }
  return diagnosis::judge(facts);
}

}  // namespace waymark::tools
