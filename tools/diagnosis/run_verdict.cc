#include "tools/diagnosis/run_verdict.h"

#include <algorithm>
#include <span>
#include <utility>

#include "io/text/number_text.h"
#include "tools/diagnosis/source_report.h"

namespace waymark::diagnosis {
namespace {

using io::fixed;

std::string counted(std::size_t n, const std::string& what) {
  return std::to_string(n) + " " + what + (n == 1 ? "" : "s");
}

double share(std::size_t part, std::size_t whole) {
  return whole == 0 ? 0.0 : static_cast<double>(part) / static_cast<double>(whole);
}

double distanceOf(const RunFacts& f) {
  return f.median_side_px > 0.0 ? f.marker_size_m * f.focal_px / f.median_side_px : 0.0;
}

// The family that is there instead of the one asked for.
const FamilyCount* otherFamily(const RunFacts& f, const VerdictLimits& limits) {
  if (!f.images) return nullptr;
  for (const FamilyCount& family : f.images->families) {
    if (family.dictionary == f.dictionary) return nullptr;
    if (family.markers >= limits.other_family_ratio * std::max(1, f.images->own.markers)) {
      return &family;
    }
  }
  return nullptr;
}

std::string otherFamilyText(const RunFacts& f, const FamilyCount& other) {
  const std::string own = f.markers_seen == 0
                              ? "no marker of " + f.dictionary + " in " + counted(f.frames, "frame")
                              : counted(f.markers_seen, "marker") + " of " + f.dictionary + " in " +
                                    counted(f.frames, "frame");
  return own + "; in " + counted(f.images->images, "image") + " of them " +
         std::to_string(other.markers) + " squares decode as " + other.dictionary + " (ids " +
         idList(other.ids) + "): --dictionary " + other.dictionary;
}

class Judge {
 public:
  Judge(const RunFacts& facts, const VerdictLimits& limits) : f_(facts), limits_(limits) {}

  Verdict verdict() {
    const FamilyCount* other = otherFamily(f_, limits_);
    if (other != nullptr) add(otherFamilyText(f_, *other));
    const bool found = f_.localized > 0 && other == nullptr;
    if (found) adviseOnPoses();
    if (other == nullptr) {
      adviseOnSizes();
      if (f_.markers_seen == 0) adviseOnNothing();
      if (!found && f_.markers_seen > 0) adviseOnMarkers();
      if (few() || f_.markers_seen == 0) adviseOnImages();
    }
    verdict_.grade =
        !found ? Verdict::Grade::kNone
               : (verdict_.advice.empty() ? Verdict::Grade::kGood : Verdict::Grade::kDoubtful);
    verdict_.text = text(other);
    return std::move(verdict_);
  }

 private:
  void add(std::string advice) { verdict_.advice.push_back(std::move(advice)); }
  [[nodiscard]] bool few() const { return share(f_.localized, f_.frames) < limits_.few_poses; }

  [[nodiscard]] std::string text(const FamilyCount* other) const {
    if (f_.localized == 0) return "no pose in " + counted(f_.frames, "frame");
    std::string poses = "a pose in " + fixed(100.0 * share(f_.localized, f_.frames), 1) + " % of " +
                        counted(f_.frames, "frame");
    if (other != nullptr) return "no pose that can be believed (" + poses + ")";
    if (f_.rms_px > 0.0) poses += ", reprojection error " + fixed(f_.rms_px, 2) + " px";
    return poses;
  }

  // There are poses; how good can they be?
  void adviseOnPoses() {
    if (f_.lens_open_share > 0.0) {
      add("the lens is not learned yet, its focal length known to " +
          fixed(100.0 * f_.lens_open_share, 2) + " %: " + kWhatTeachesALens);
    }
    const double rejected = share(f_.rejected_markers, f_.markers_seen);
    if (f_.rms_px > (f_.own_corners ? limits_.large_rms_px : limits_.large_rms_of_others_px)) {
      add("the reprojection error is " + fixed(f_.rms_px, 2) + " px where 0.1 is usual: " +
          (f_.lens_given ? "is the calibration this lens's, at this zoom and focus? "
                           "waymark calibrate makes one"
                         : "the lens may be learned wrongly; waymark calibrate measures it"));
    } else if (rejected > limits_.many_rejected) {
      add(fixed(100.0 * rejected, 0) +
          " % of the markers seen contradict the others: the calibration, markers that were "
          "moved or hang twice, or of several sizes (--sizes)?");
    }
    if (few() && 2 * f_.frames_with_markers < f_.frames) {
      add("no marker is in view in " +
          fixed(100.0 * (1.0 - share(f_.frames_with_markers, f_.frames)), 0) + " % of the frames");
    }
    if (few() && f_.frames_with_markers > 2 * f_.localized) {
      add("markers were in view in " + counted(f_.frames_with_markers, "frame") +
          ", and most of these have no pose; most often: " + mostCommonReason());
    }
  }

  void adviseOnSizes() {
    const double distance_m = distanceOf(f_);
    if (f_.marker_size_m > limits_.large_marker_m || distance_m > limits_.far_marker_m) {
      std::string text = "markers of " + fixed(f_.marker_size_m, 2) + " m";
      if (distance_m > 0.0) {
        text += ", which are then " + fixed(distance_m, distance_m < 10.0 ? 1 : 0) + " m away";
      }
      add(text + ": --marker-size is the side of the black square in metres (165 mm are 0.165)");
    }
    if (f_.markers_seen > 0 && f_.median_side_px < limits_.small_side_px) {
      add("the markers are small in the image (" + fixed(f_.median_side_px, 0) +
          " pixels a side): closer, larger prints, or a larger image");
    }
  }

  // Not one marker.
  void adviseOnNothing() {
    if (f_.images && f_.images->odd.mirrored) {
      const FamilyCount& seen = *f_.images->odd.mirrored;
      add("the images are mirrored: turned left to right, " + std::to_string(seen.markers) +
          " squares decode as " + seen.dictionary);
    } else if (f_.images && f_.images->odd.inverted) {
      const FamilyCount& seen = *f_.images->odd.inverted;
      add("the markers are white on black: as negatives, " + std::to_string(seen.markers) +
          " squares decode as " + seen.dictionary + "; print them black on white");
    } else if (f_.images && f_.quads == 0) {
      add("there is no dark square in any frame: are the markers in view, with a white border, "
          "and at least 7 pixels a side?");
    } else if (f_.images) {
      add("squares were found (" + std::to_string(f_.quads) +
          " in all frames), and none of them is a marker of any family known here");
    } else {
      add("no frame has a marker");
    }
  }

  // Markers, and no pose.
  void adviseOnMarkers() {
    add("most often: " + mostCommonReason());
    if (f_.seen_by_id.size() == 1) {
      add("one marker only was seen, id " + std::to_string(f_.seen_by_id.begin()->first) + ", " +
          std::to_string(f_.seen_by_id.begin()->second) +
          " times: go closer, look at it from an angle, or hang up more");
    }
  }

  void adviseOnImages() {
    if (!f_.images) return;
    for (std::string& line : qualityAdvice(f_.images->quality)) add(std::move(line));
  }

  [[nodiscard]] std::string mostCommonReason() const {
    const auto most = std::ranges::max_element(f_.reasons, {},
                                               &std::pair<const std::string, std::size_t>::second);
    if (most == f_.reasons.end()) return "nothing is said";
    return most->first + " (" + counted(most->second, "frame") + ")";
  }

  const RunFacts& f_;
  const VerdictLimits& limits_;
  Verdict verdict_;
};

}  // namespace

bool wantsImages(const RunFacts& facts) {
  const VerdictLimits limits;
  return facts.frames > 0 && share(facts.localized, facts.frames) < limits.few_poses;
}

ImageFacts lookAt(std::span<const GreyImage> images, const std::string& dictionary,
                  const slam::CameraModel& camera) {
  ImageFacts facts;
  facts.images = images.size();
  facts.quality = medianQuality(images);
  facts.families = surveyFamilies(images, camera);
  facts.own = countFamily(dictionary, images, camera);
  if (facts.families.empty() && facts.own.markers == 0)
    facts.odd = lookForOddImages(images, camera);
  return facts;
}

Verdict judge(const RunFacts& facts, const VerdictLimits& limits) {
  return Judge(facts, limits).verdict();
}

const char* gradeName(Verdict::Grade grade) {
  switch (grade) {
    case Verdict::Grade::kGood:
      return "good";
    case Verdict::Grade::kDoubtful:
      return "doubtful";
    case Verdict::Grade::kNone:
      return "none";
  }
  return "";
}

std::string formatVerdict(const Verdict& verdict) {
  std::string text =
      std::string("verdict: ") +
      (verdict.grade == Verdict::Grade::kNone ? "" : std::string(gradeName(verdict.grade)) + ": ") +
      verdict.text + "\n";
  for (const std::string& line : verdict.advice) text += "  - " + line + "\n";
  return text;
}

}  // namespace waymark::diagnosis
