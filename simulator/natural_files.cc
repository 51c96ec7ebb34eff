#include "simulator/natural_files.h"

#include <algorithm>
#include <string>
#include <system_error>
#include <vector>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "io/pictures/natural_marker_file.h"
#include "io/text/json_node.h"
#include "io/text/text_file.h"

namespace waymark::simulator {
namespace {

namespace fs = std::filesystem;

const char* const kPictures = "natural";  // the directory
const char* const kTargets = "gt_targets.json";

fs::path imageOf(const NaturalPicture& natural) {
  std::string name = natural.name + ".png";
  std::ranges::replace(name, ' ', '_');
  return fs::path(kPictures) / name;
}

// A file of natural markers, and which ones are in it: all, or `only` and those that hang nowhere.
struct MarkerList {
  fs::path file;
  const NaturalPicture* only;
};

std::vector<MarkerList> listsOf(const Scene& scene) {
  std::vector<MarkerList> lists;
  if (scene.natural.empty()) return lists;
  lists.push_back({"natural.json", nullptr});
  for (const NaturalPicture& natural : scene.natural) {
    if (natural.T_w_m) lists.push_back({"natural_" + natural.name + ".json", &natural});
  }
  return lists;
}

Status writeList(const fs::path& directory, const MarkerList& list, const Scene& scene) {
  const fs::path file = directory / list.file;
  std::string text;
  for (const NaturalPicture& natural : scene.natural) {
    if (list.only != nullptr && natural.T_w_m && &natural != list.only) continue;
    Result<std::string> longer = io::withNaturalMarker(text, file,
                                                       {.name = natural.name,
                                                        .image = imageOf(natural),
                                                        .width_m = natural.width_m,
                                                        .height_m = natural.height_m,
                                                        .T_w_m = natural.T_w_m});
    if (!longer) return longer.error();
    text = std::move(*longer);
  }
  return io::writeTextFile(file, text);
}

Status writePictures(const fs::path& directory, const Scene& scene) {
  std::error_code failed;
  fs::create_directory(directory / kPictures, failed);
  if (failed) return Error{(directory / kPictures).string() + ": " + failed.message()};
  for (const NaturalPicture& natural : scene.natural) {
    const fs::path file = directory / imageOf(natural);
    const PosterImage& picture = natural.picture;
    const cv::Mat grey(picture.height, picture.width, CV_8U,
                       const_cast<std::uint8_t*>(picture.grey.data()));
    if (!cv::imwrite(file.string(), grey)) return Error{file.string() + ": cannot write"};
  }
  return success();
}

std::string targetsText(const Scene& scene) {
  io::Json json = {{"note", "simulated " + scene.name +
                                ": points that can be seen, metres, in the frame of gt_traj.txt"},
                   {"targets", io::Json::array()}};
  for (const Target& target : scene.targets) {
    json["targets"].push_back({{"name", target.name}, {"p", io::toJson(target.p_w)}});
  }
  return json.dump(1) + "\n";
}

}  // namespace

Status writeNatural(const fs::path& directory, const Scene& scene) {
  if (!scene.natural.empty()) {
    if (Status status = writePictures(directory, scene); !status) return status;
  }
  for (const MarkerList& list : listsOf(scene)) {
    if (Status status = writeList(directory, list, scene); !status) return status;
  }
  if (scene.targets.empty()) return success();
  return io::writeTextFile(directory / kTargets, targetsText(scene));
}

void removeNatural(const fs::path& directory, const Scene& scene) {
  std::error_code ignored;
  for (const MarkerList& list : listsOf(scene)) fs::remove(directory / list.file, ignored);
  if (!scene.targets.empty()) fs::remove(directory / kTargets, ignored);
  if (scene.natural.empty()) return;
  for (const NaturalPicture& natural : scene.natural) {
    fs::remove(directory / imageOf(natural), ignored);
  }
  fs::remove(directory / kPictures, ignored);  // where nothing else is in it
}

}  // namespace waymark::simulator
