#include "tools/run_results.h"

#include <algorithm>
#include <cstddef>
#include <filesystem>
#include <iterator>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "io/calibrations/calibration_file.h"
#include "io/frame_poses.h"
#include "io/maps/map_file.h"
#include "io/maps/map_picture.h"
#include "io/recorded_detections.h"
#include "slam/final_map.h"
#include "slam/map/world_reference.h"

namespace waymark::tools {
namespace {

// A map that was only localized in stays what it was, byte for byte.
std::string mapText(const slam::Slam& slam, const slam::Map& main_piece, const RunSetup& setup) {
  if (!setup.options.mapping) return setup.old_map->text;
  const std::optional<io::FieldSize> field =
      setup.old_map ? setup.old_map->file.field : std::nullopt;
  std::vector<slam::Map> pieces = slam::piecesThroughOneLens(slam);
  const auto main = std::ranges::find(pieces, main_piece.piece, &slam::Map::piece);
  std::rotate(pieces.begin(), main, std::next(main));
  return io::formatMap(pieces, slam.lens().calibrationOf(slam.camera()), slam.readout_s(), field);
}

// The piece of the map that files of one world are of: the one with an anchor, or else the one with
// the most frames.
const slam::Map& mainPiece(const slam::Slam& slam, const slam::MarkerOptions& markers,
                           const std::map<int, io::Trajectory>& trajectories) {
  const auto frames = [&](const slam::Map* map) {
    const auto found = trajectories.find(map->piece);
    return std::pair(!slam::firstKeyframeIsWorld(*map, markers),
                     found == trajectories.end() ? std::size_t{0} : found->second.size());
  };
  const std::vector<const slam::Map*> pieces = slam.pieces();
  return **std::ranges::max_element(pieces, {}, frames);  // the oldest of several such
}

// NAME.tum of the main piece, and NAME_PIECE.tum of each other one.
void addTrajectories(const std::string& name, int main_piece,
                     std::map<int, io::Trajectory> trajectories, io::OutputDirectory* output) {
  output->add(name + ".tum", io::formatTrajectory(trajectories[main_piece]));
  trajectories.erase(main_piece);
  for (const auto& [piece, trajectory] : trajectories) {
    output->add(name + "_" + std::to_string(piece) + ".tum", io::formatTrajectory(trajectory));
  }
}

// All pieces, the main one first.
std::string pictureText(const slam::Slam& slam, const slam::Map& main_piece,
                        const std::map<int, io::Trajectory>& trajectories, const RunSetup& setup) {
  io::MapPicture picture{.title = setup.input->description(),
                         .pieces = {},
                         .photographs = setup.input->unorderedImages()};
  const auto add = [&](const slam::Map& map) {
    const auto found = trajectories.find(map.piece);
    picture.pieces.push_back(
        {.piece = map.piece,
         .markers = io::posedMarkerCorners(map),
         .natural = io::posedNaturalMarkerCorners(map),
         .estimate = found == trajectories.end() ? io::Trajectory() : found->second});
  };
  add(main_piece);
  for (const slam::Map* const map : slam.pieces()) {
    if (map != &main_piece) add(*map);
  }
  return io::formatMapPicture(picture);
}

}  // namespace

Status writeResults(const slam::Slam& slam,
                    const std::function<std::string(const std::string&)>& statistics,
                    const std::string& incomplete, const RunRecord& record, RunSetup& setup) {
  io::OutputDirectory& output = *setup.output;
  const auto final_poses = record.finalPoses(slam, setup.input->unorderedImages());
  auto final_trajectories = io::trajectoriesOf(final_poses);
  const slam::Map& map = mainPiece(slam, setup.options.markers, final_trajectories);
  output.add("stats.json", statistics(incomplete));
  const auto live_poses = record.livePoses();
  addTrajectories("trajectory", map.piece, io::trajectoriesOf(live_poses), &output);
  output.add("poses.csv", io::formatFramePoses(live_poses));
  output.add("map.json", mapText(slam, map, setup));
  addTrajectories("trajectory_final", map.piece, final_trajectories, &output);
  output.add("poses_final.csv", io::formatFramePoses(final_poses));
  output.add(setup.calibration_name,
             io::formatCalibration(slam.lens().calibrationOf(slam.camera())));
  output.add("map.svg", pictureText(slam, map, final_trajectories, setup));
  Status written = output.commit();
  if (written) return written;
  output.add("stats.json", statistics(written.error().message));
  std::string message = written.error().message + "; missing:";
  for (const std::string& name : output.commitWhatFits()) message += " " + name;
  return Error{message};
}

Status writeDetections(const std::string& file, const RunRecord& record,
                       const slam::CameraModel& camera, io::OutputDirectory& directory) {
  const std::vector<io::RecordedFrame> frames = record.recordedFrames();
  directory.add(std::filesystem::path(file).filename(),
                io::formatRecordedDetections(frames, camera));
  directory.add("frames.csv", io::formatFrameTimes(frames));
  return directory.commit();
}

}  // namespace waymark::tools
