#include "tools/natural_command.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <CLI/CLI.hpp>

#include "base/freed_memory.h"
#include "io/calibrations/calibration_file.h"
#include "io/pictures/natural_marker_file.h"
#include "io/pictures/natural_marker_set.h"
#include "io/text/number_text.h"
#include "io/text/text_file.h"
#include "slam/natural/pictures/alike_pictures.h"
#include "slam/natural/pictures/picture_finder.h"
#include "tools/exit_code.h"
#include "tools/natural/picture_range.h"
#include "tools/number_arguments.h"

namespace waymark::tools {
namespace {

namespace fs = std::filesystem;

// What a subcommand has to say on stdout.
using Outcome = Result<std::string>;

struct AddArguments {
  std::string file;
  std::string image;
  std::string name;
  double width_m = 0.0;
  double height_m = 0.0;
  std::vector<double> position_m;   // x y z
  std::vector<double> orientation;  // w x y z
  bool alike = false;
};

struct ListArguments {
  std::string file;
};

struct CheckArguments {
  std::string file;
  std::string calibration;
  bool no_rendering = false;
};

std::string percent(double share) { return io::fixed(100.0 * share, 0) + " %"; }

std::string sizeOf(const slam::NaturalMarker& marker) {
  return io::fixed(marker.width_m(), 3) + " x " + io::fixed(marker.height_m(), 3) + " m";
}

// The pose of --position and --orientation. Empty when neither is given.
Result<std::optional<slam::Transform>> poseOf(const AddArguments& arguments) {
  if (arguments.position_m.empty() && arguments.orientation.empty()) {
    return std::optional<slam::Transform>();
  }
  if (arguments.position_m.empty()) return Error{"--orientation needs --position"};
  const std::vector<double>& p = arguments.position_m;
  Eigen::Quaterniond q = Eigen::Quaterniond::Identity();
  if (!arguments.orientation.empty()) {
    const std::vector<double>& o = arguments.orientation;
    q = Eigen::Quaterniond(o[0], o[1], o[2], o[3]);
    if (!(std::abs(q.norm() - 1.0) < 1e-3)) return Error{"--orientation is no unit quaternion"};
  }
  return std::optional(slam::Transform::fromQuaternion(q, {p[0], p[1], p[2]}));
}

// As the file says it: relative to its folder where the image is in it or below.
fs::path pathWithin(const fs::path& file, const fs::path& image) {
  std::error_code error;
  const fs::path folder = fs::absolute(file, error).parent_path();
  const fs::path relative = fs::absolute(image, error).lexically_relative(folder);
  const bool below = !relative.empty() && *relative.begin() != "..";
  return below ? relative : fs::absolute(image, error).lexically_normal();
}

// Whether a new picture may be in a file with these: whoever reads it would refuse the same picture
// twice, whatever --alike says.
Status checkNew(io::NaturalMarkerSet set, io::NaturalPicture picture,
                const AddArguments& arguments) {
  const auto same = std::ranges::find(set.keys, picture.key);
  if (same != set.keys.end()) {
    const auto place = static_cast<std::size_t>(same - set.keys.begin());
    return Error{arguments.image + ": is the same picture as that of '" +
                 io::oneLine(set.entries[place].name) + "'"};
  }
  if (arguments.alike) return success();
  const int last = static_cast<int>(set.markers.size());
  set.markers.push_back(std::move(picture.marker));
  for (const slam::AlikePictures& pair : slam::findAlike(set.markers)) {
    if (pair.second != last) continue;
    return Error{arguments.image + ": looks like '" +
                 io::oneLine(set.entries[static_cast<std::size_t>(pair.first)].name) + "': " +
                 percent(pair.share) + " of its features are the same (--alike adds it anyway)"};
  }
  return success();
}

Outcome add(const AddArguments& arguments) {
  const Result<std::optional<slam::Transform>> pose = poseOf(arguments);
  if (!pose) return pose.error();
  auto picture = io::readNaturalMarker(arguments.image, arguments.width_m, arguments.height_m);
  if (!picture) return picture.error();
  const slam::PictureQuality quality = picture->marker.quality();
  const std::string size = sizeOf(picture->marker);
  const std::string note = picture->note.empty() ? std::string() : picture->note + "\n";

  io::NaturalMarkerEntry entry;
  entry.name = arguments.name.empty() ? fs::path(arguments.image).stem().string() : arguments.name;
  entry.image = pathWithin(arguments.file, arguments.image);
  entry.width_m = arguments.width_m;
  entry.height_m = arguments.height_m;
  entry.T_w_m = *pose;
  std::string before;
  std::error_code error;
  if (fs::exists(arguments.file, error)) {
    Result<std::string> text = io::readTextFile(arguments.file);
    if (!text) return text.error();
    before = std::move(*text);
  }
  const Result<std::string> after = io::withNaturalMarker(before, arguments.file, entry);
  if (!after) return after.error();
  if (!before.empty()) {
    auto set = io::readNaturalMarkers(arguments.file);
    if (!set) return set.error();
    const Status is_new = checkNew(std::move(*set), std::move(*picture), arguments);
    if (!is_new) return is_new.error();
  }
  const Status written = io::writeTextFile(arguments.file, *after);
  if (!written) return written.error();
  return note + entry.name + ": " + size + ", " + std::to_string(quality.distinct_features) +
         " distinct features\n";
}

Outcome list(const ListArguments& arguments) {
  const Result<std::string> text = io::readTextFile(arguments.file);
  if (!text) return text.error();
  const auto entries = io::parseNaturalMarkers(*text, arguments.file);
  if (!entries) return entries.error();
  std::string out;
  for (const io::NaturalMarkerEntry& entry : *entries) {
    out +=
        entry.name + ": " + entry.image.string() + ", " + io::fixed(entry.width_m, 3) + " m wide";
    if (entry.height_m > 0.0) out += ", " + io::fixed(entry.height_m, 3) + " m high";
    if (entry.T_w_m) {
      const Eigen::Vector3d& p = entry.T_w_m->p;
      out += ", at (" + io::fixed(p.x(), 3) + ", " + io::fixed(p.y(), 3) + ", " +
             io::fixed(p.z(), 3) + ") m";
    } else {
      out += ", place to be found";
    }
    out += "\n";
  }
  return out;
}

std::string rangeText(const PictureRange& range) {
  const std::string tilt = io::fixed(range.tilt_deg, 0) + " degrees: ";
  if (!range.nearest_m) return tilt + "not found";
  return tilt + io::fixed(*range.nearest_m, 2) + " to " + io::fixed(*range.farthest_m, 2) + " m";
}

// Printed as it comes: rendering takes a second or two a picture.
Outcome check(const CheckArguments& arguments) {
  slam::Calibration camera = ordinaryCamera();
  if (!arguments.calibration.empty()) {
    const auto given = io::readCalibration(arguments.calibration);
    if (!given) return given.error();
    camera = *given;
  }
  const auto set = io::readNaturalMarkers(arguments.file);
  if (!set) return set.error();
  for (const std::string& note : set->notes) std::printf("%s\n", note.c_str());
  keepFreedMemory();  // local features take and free megabytes for each image
  slam::PictureFinder finder(set->markers);
  for (std::size_t i = 0; i < set->markers.size(); ++i) {
    const slam::NaturalMarker& marker = set->markers[i];
    const slam::PictureQuality& quality = marker.quality();
    std::printf("%s: %s, contrast %.0f, %d features, %s of them repeated\n",
                set->entries[i].name.c_str(), sizeOf(marker).c_str(), quality.contrast,
                quality.features, percent(quality.repeatedShare()).c_str());
    if (arguments.no_rendering) continue;
    for (const PictureRange& range : pictureRange(marker, static_cast<int>(i), camera, &finder)) {
      std::printf("  found at %s\n", rangeText(range).c_str());
    }
    std::fflush(stdout);
  }
  std::string text;
  for (const slam::AlikePictures& pair : set->alike) {
    text += set->entries[static_cast<std::size_t>(pair.first)].name + " and " +
            set->entries[static_cast<std::size_t>(pair.second)].name +
            " look alike: " + percent(pair.share) + " of the features\n";
  }
  return text.empty() ? "no two look alike\n" : text;
}

// Runs a subcommand with its arguments when it was chosen.
template <typename Arguments>
void onNaturalCall(CLI::App* command, const std::shared_ptr<Arguments>& arguments,
                   Outcome (*run)(const Arguments&), int* exit_code) {
  command->callback([arguments, run, exit_code] {
    const Outcome outcome = run(*arguments);
    if (!outcome) std::fprintf(stderr, "waymark: %s\n", outcome.error().message.c_str());
    if (outcome) std::fputs(outcome->c_str(), stdout);
    *exit_code = outcome ? kDone : kBadInput;
  });
}

void addAdd(CLI::App& natural, int* exit_code) {
  CLI::App* command = natural.add_subcommand("add", "Put a picture into a file of natural markers");
  const auto arguments = std::make_shared<AddArguments>();
  command->add_option("file", arguments->file, "The FILE.json, made where there is none")
      ->required();
  command->add_option("image", arguments->image, "The picture; its edges are the marker's")
      ->required();
  command->add_option("--width", arguments->width_m, "Of the print, metres")
      ->required()
      ->check(numberFrom(1e-4, 1e3));
  command
      ->add_option("--height", arguments->height_m,
                   "Of the print, metres, where the picture's shape does not tell it")
      ->check(numberFrom(1e-4, 1e3));
  command->add_option("--name", arguments->name, "Without it: the image's name");
  command
      ->add_option("--position", arguments->position_m,
                   "Of the print's centre in the world, x y z in metres, where it was surveyed")
      ->expected(3);
  command
      ->add_option("--orientation", arguments->orientation,
                   "Of the print (x right, y up, z out of it) in the world, w x y z")
      ->expected(4);
  command->add_flag("--alike", arguments->alike, "Although it looks like one that is there");
  onNaturalCall(command, arguments, add, exit_code);
}

void addList(CLI::App& natural, int* exit_code) {
  CLI::App* command = natural.add_subcommand("list", "Say what is in a file of natural markers");
  const auto arguments = std::make_shared<ListArguments>();
  command->add_option("file", arguments->file, "The FILE.json")->required();
  onNaturalCall(command, arguments, list, exit_code);
}

void addCheck(CLI::App& natural, int* exit_code) {
  CLI::App* command = natural.add_subcommand(
      "check", "Say how well pictures will do: texture, distances and tilts, which look alike");
  const auto arguments = std::make_shared<CheckArguments>();
  command->add_option("file", arguments->file, "The FILE.json")->required();
  command->add_option("--calibration", arguments->calibration,
                      "The camera to render for; without it 640x480, 64 degrees across");
  command->add_flag("--no-rendering", arguments->no_rendering,
                    "Without distances, which take a second or two a picture");
  onNaturalCall(command, arguments, check, exit_code);
}

}  // namespace

void addNaturalCommand(CLI::App& app, int* exit_code) {
  CLI::App* natural =
      app.add_subcommand("natural", "Natural markers: pictures in the scene whose print is known");
  natural->require_subcommand(1);
  addAdd(*natural, exit_code);
  addList(*natural, exit_code);
  addCheck(*natural, exit_code);
}

}  // namespace waymark::tools
