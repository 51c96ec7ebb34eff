#include "tools/setup_command.h"

#include <cstdio>
#include <filesystem>
#include <functional>
#include <iostream>
#include <memory>
#include <optional>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include <CLI/CLI.hpp>
#include <opencv2/core.hpp>
#include <unistd.h>

#include "capture/open_source.h"
#include "capture/v4l2/camera_list.h"
#include "daemon/configuration.h"
#include "daemon/control/stop_signal.h"
#include "daemon/frames/camera_setup.h"
#include "io/settings/slam_settings.h"
#include "io/text/number_text.h"
#include "io/text/text_file.h"
#include "tools/diagnosis/family_survey.h"
#include "tools/exit_code.h"
#include "tools/number_arguments.h"
#include "tools/source_look.h"

namespace waymark::tools {
namespace {

namespace fs = std::filesystem;

struct SetupArguments {
  std::string camera;
  std::string dictionary;
  std::string marker_size;
  std::string calibration;
  std::string out;
  std::string map;
  bool service = false;
  bool force = false;
};

// What is asked for where no option says it; only a person at a terminal can be asked.
class Questions {
 public:
  // What is wrong with an answer; empty: nothing.
  using Check = std::function<std::optional<std::string>(const std::string& answer)>;

  // `proposal`: what a bare return means; may be empty. Asked again until `check` is content. An
  // error where nobody can be asked.
  Result<std::string> ask(const std::string& question, const std::string& proposal,
                          const char* option, const Check& check) const {
    if (!at_terminal_) {
      if (!proposal.empty()) return proposal;
      return Error{std::string(option) + " is required (nobody can be asked here): " + question};
    }
    for (;;) {
      std::printf("%s%s: ", question.c_str(),
                  proposal.empty() ? "" : (" [" + proposal + "]").c_str());
      std::fflush(stdout);
      std::string answer;
      if (!std::getline(std::cin, answer)) return Error{"setup: no answer"};
      if (answer.empty()) answer = proposal;
      if (answer.empty()) continue;
      const std::optional<std::string> objection = check(answer);
      if (!objection) return answer;
      std::printf("%s\n", objection->c_str());
    }
  }

 private:
  const bool at_terminal_ = ::isatty(STDIN_FILENO) == 1 && ::isatty(STDOUT_FILENO) == 1;
};

Result<std::string> chooseCamera(const Questions& questions) {
  const std::vector<capture::v4l2::Camera> cameras = capture::v4l2::listCameras().cameras;
  if (cameras.empty()) {
    return Error{
        "setup: there is no camera here; --camera names one (libcamera:0, a recording, or "
        "sim:walls "
        "to try without)"};
  }
  for (const capture::v4l2::Camera& camera : cameras) {
    std::printf("v4l2:%s  %s\n", camera.path.c_str(), camera.card.name.c_str());
  }
  return questions.ask("Camera", "v4l2:" + cameras.front().path, "--camera",
                       [](const std::string&) { return std::nullopt; });
}

std::string quoted(const std::string& text) {
  std::string result = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') result += '\\';
    result += c;
  }
  return result + '"';
}

// The configuration; size: of the images, where a camera without a calibration needs it.
std::string configurationText(const SetupArguments& a, const std::string& size) {
  std::string text =
      "# Written by waymark setup. waymarkd.toml(5) explains these keys, and all others.\n\n"
      "[camera]\nsource = " +
      quoted(a.camera) + "\n";
  if (!a.calibration.empty()) {
    text += "calibration = " + quoted(fs::absolute(a.calibration).string()) + "\n";
  } else if (!a.camera.starts_with("sim:")) {
    text += "# No calibration: the lens is learned from the markers.\n" + size;
  }
  text += "\n[slam]\ndictionary = " + quoted(a.dictionary) +
          "\n# Side of the printed black square, metres: the scale of everything.\n"
          "marker_size_m = " +
          a.marker_size +
          "\n# Goes on with the map of the last time, and keeps it. Take both lines out to begin "
          "anew at "
          "each start.\nmap_in = " +
          quoted(a.map) + "\nmap_out = " + quoted(a.map) + "\n";
  return text;
}

// As the daemon would open it; a camera at its own choice of a size.
Result<std::unique_ptr<capture::FrameSource>> openCamera(const SetupArguments& arguments) {
  if (!arguments.camera.starts_with("sim:")) return capture::openSource(arguments.camera, {});
  SetupArguments any = arguments;
  if (any.dictionary.empty()) any.dictionary = "ARUCO_MIP_36h12";
  any.marker_size = "0.1";
  const auto configuration = daemon::parseConfiguration(configurationText(any, ""), arguments.out);
  if (!configuration) return configuration.error();
  const auto setup = daemon::prepareCamera(*configuration);
  if (!setup) return setup.error();
  return setup->opener.open();
}

// The family that is in view, which is what somebody asked for or is asked about.
Status chooseDictionary(const Looked& looked, const Questions& questions, SetupArguments* a) {
  const auto& images = looked.samples.images();
  const slam::CameraModel camera = diagnosis::guessedCamera(looked.info.width, looked.info.height);
  const auto families = diagnosis::surveyFamilies(images, camera);
  for (const diagnosis::Finding& finding :
       diagnosis::familyFindings(families, {}, images.size(), a->dictionary)) {
    tell(finding);
  }
  if (a->dictionary.empty()) {
    const std::string found = families.empty() ? "" : families.front().dictionary;
    const Result<std::string> answer = questions.ask(
        found.empty() ? "Dictionary of the markers (none is in view: waymark print makes some)"
                      : "Dictionary of the markers",
        found, "--dictionary", io::validateDictionary);
    if (!answer) return answer.error();
    a->dictionary = *answer;
  }
  if (const auto objection = io::validateDictionary(a->dictionary)) {
    return Error{"--dictionary: " + *objection};
  }
  return success();
}

std::optional<std::string> objectionToSize(const std::string& text) {
  constexpr double kSmallest_m = 0.001;
  constexpr double kLargest_m = 5.0;
  const std::optional<double> size_m = io::parseDouble(text);
  if (size_m && *size_m > kLargest_m) {
    return text + " m is larger than any print; " + text + " mm are " +
           io::roundTrip(*size_m / 1000.0);
  }
  if (!size_m || *size_m < kSmallest_m) {
    return "'" + text + "' must be a number of metres, e.g. 0.165";
  }
  return std::nullopt;
}

Status chooseSize(const Questions& questions, SetupArguments* a) {
  if (a->marker_size.empty()) {
    const Result<std::string> answer =
        questions.ask("Side of the printed black square, measured, metres (0.165)", "",
                      "--marker-size", objectionToSize);
    if (!answer) return answer.error();
    a->marker_size = *answer;
  }
  if (const auto objection = objectionToSize(a->marker_size)) {
    return Error{"--marker-size: " + *objection};
  }
  return success();
}

// The source as it is now. Whoever is asked something later may leave by Ctrl-C.
Result<Looked> look(const SetupArguments& arguments) {
  constexpr int kFrames = 90;
  const daemon::StopSignal stop;  // before the source has threads, which must not take the signal
  const Result<std::unique_ptr<capture::FrameSource>> source = openCamera(arguments);
  if (!source) return Error{withPermissionHint(source.error().message)};
  Result<Looked> looked = lookAt(**source, kFrames, stop);
  if (looked && stop.pending()) return Error{"setup: interrupted"};
  daemon::StopSignal::release();
  return looked;
}

void sayWhatComesNext(const SetupArguments& a) {
  std::printf("\n%s is written. Next:\n", a.out.c_str());
  std::printf("  waymarkd --check --config %s   # what it comes to\n", a.out.c_str());
  if (a.service) {
    std::printf("  sudo systemctl enable --now waymarkd   # now, and at every start\n");
  } else {
    std::printf("  waymarkd --config %s           # until Ctrl-C\n", a.out.c_str());
  }
  std::printf(
      "  waymark view                             # the map, the camera and its image in a "
      "browser\n"
      "  waymark echo                             # the poses, as text\n");
  if (!a.service) {
    std::printf("As a service: sudo waymark setup --service, with the same answers\n");
  }
}

Status setUp(SetupArguments* a) {
  cv::setNumThreads(1);
  const Questions questions;
  if (a->out.empty()) a->out = a->service ? "/etc/waymark/waymarkd.toml" : "waymarkd.toml";
  if (a->map.empty()) a->map = a->service ? "/var/lib/waymark/map.json" : "map.json";
  std::error_code error;
  if (!a->force && fs::exists(a->out, error)) {
    return Error{a->out + ": is there already; --force takes its place"};
  }
  if (a->camera.empty()) {
    const Result<std::string> camera = chooseCamera(questions);
    if (!camera) return camera.error();
    a->camera = *camera;
  }
  // Paths in a configuration count from its own directory.
  if (fs::exists(a->camera, error)) a->camera = fs::absolute(a->camera).string();
  const Result<Looked> looked = look(*a);
  if (!looked) return looked.error();
  tellOfSource(*looked);
  if (Status chosen = chooseDictionary(*looked, questions, a); !chosen) return chosen;
  if (Status chosen = chooseSize(questions, a); !chosen) return chosen;
  tellOfComputer();
  std::string size;
  if (capture::isCamera(a->camera)) {
    size = "width = " + std::to_string(looked->info.width) +
           "\nheight = " + std::to_string(looked->info.height) + "\n";
  }
  const std::string text = configurationText(*a, size);
  // What is written is what the daemon takes.
  if (const auto read = daemon::parseConfiguration(text, a->out); !read) return read.error();
  if (Status written = io::writeTextFile(a->out, text); !written) return written;
  sayWhatComesNext(*a);
  return success();
}

}  // namespace

void addSetupCommand(CLI::App& app, int* exit_code) {
  CLI::App* const command = app.add_subcommand(
      "setup", "Look at a camera, ask what is not said, and write waymarkd.toml");
  const auto a = std::make_shared<SetupArguments>();
  command->add_option("--camera", a->camera,
                      "v4l2:/dev/video0, libcamera:0, a recording, or sim:walls to try without a "
                      "camera; else asked for");
  command->add_option("--dictionary", a->dictionary,
                      "Marker dictionary; else the one that is in view, or asked for");
  command->add_option("--marker-size", a->marker_size,
                      "Side of the printed black square, metres; else asked for");
  command
      ->add_option("--calibration", a->calibration, "The camera's; without one the lens is learned")
      ->check(CLI::ExistingFile);
  command->add_option("--out", a->out,
                      "Configuration to write; else waymarkd.toml, with --service "
                      "/etc/waymark/waymarkd.toml");
  command->add_option(
      "--map", a->map,
      "Where the map is kept; else map.json beside the configuration, with --service "
      "/var/lib/waymark/map.json");
  command->add_flag("--service", a->service, "For waymarkd.service");
  command->add_flag("--force", a->force, "Also in the place of a configuration");
  command->callback([a, exit_code] {
    const Status status = setUp(a.get());
    if (!status) std::fprintf(stderr, "waymark: %s\n", status.error().message.c_str());
    *exit_code = status ? kDone : kBadInput;
  });
}

}  // namespace waymark::tools
