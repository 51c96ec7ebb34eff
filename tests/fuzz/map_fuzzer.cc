// Our own maps. What is accepted is written as it is read, can be localized in and goes on growing,
// and what has become of it then can be read again.
#include <algorithm>
#include <map>
#include <string>
#include <vector>

#include "io/maps/map_file.h"
#include "slam/slam.h"
#include "tests/fuzz/fuzz_target.h"

using namespace waymark;

namespace {

// The checksum would keep nearly every mutation away from what is behind it; without the line a map
// is taken as it is.
std::string withoutChecksum(std::string text) {
  const std::size_t begin = text.find("\"checksum\":\"fnv1a64:");
  if (begin == std::string::npos) return text;
  const std::size_t end = text.find('\n', begin);
  return text.erase(begin, end == std::string::npos ? end : end - begin + 1);
}

std::string readAndWritten(const std::string& text, const char* what) {
  const auto file = io::parseMap(text, "again.json");
  fuzz::require(file.ok(), std::string(what) + " is read again: " +
                               (file ? std::string() : file.error().message) + "\n" + text);
  return io::formatMap(file->map, file->camera, file->readout_s, file->field);
}

// The views of the last keyframes once more, as if the camera went on from there.
std::vector<std::vector<slam::MarkerDetection>> lastViews(const slam::Map& map) {
  constexpr std::size_t kMaxFrames = 4;
  std::vector<std::vector<slam::MarkerDetection>> views;
  for (auto entry = map.keyframes().rbegin();
       entry != map.keyframes().rend() && views.size() < kMaxFrames; ++entry) {
    views.push_back(entry->second.detections.get());
  }
  std::reverse(views.begin(), views.end());
  return views;
}

// The dictionaries stay: to reckon their codes' distances takes longer than everything else.
const slam::Dictionary& dictionaryOf(const std::string& name) {
  static std::map<std::string, slam::Dictionary> known;
  if (!known.contains(name)) known.emplace(name, *slam::Dictionary::byName(name));
  return known.at(name);
}

// What the SLAM makes of the map.
std::string goneOnWith(const io::MapFile& file, bool mapping) {
  slam::Options options;
  options.mapping = mapping;
  options.shutter.learned_s = file.readout_s;
  slam::Slam slam(slam::CameraModel(*file.camera), dictionaryOf(file.map.dictionary), options,
                  file.map);
  slam::FrameTime time;
  for (const auto& view : lastViews(file.map)) {
    (void)slam.process({.time = time, .detections = view});
    ++time.sequence;
    time.monotonic_ns += 33'333'333;
  }
  slam.finish();
  return io::formatMap(slam.map(), slam.camera().calibration(), slam.readout_s());
}

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto file = io::parseMap(withoutChecksum(fuzz::textOf(data, size)), "map.json");
  if (!file) {
    fuzz::requireOneLine(file.error());
    return 0;
  }
  const std::string text = io::formatMap(file->map, file->camera, file->readout_s, file->field);
  fuzz::require(readAndWritten(text, "what was read") == text, "a map keeps its bytes:\n" + text);
  if (!file->camera) return 0;
  (void)goneOnWith(*file, false);
  (void)readAndWritten(goneOnWith(*file, true), "a map that has gone on");
  return 0;
}
