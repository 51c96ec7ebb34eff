#include "tools/doctor_command.h"

#include <cstdio>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <CLI/CLI.hpp>
#include <opencv2/core.hpp>

#include "capture/open_source.h"
#include "daemon/control/stop_signal.h"
#include "io/calibrations/calibration_file.h"
#include "io/settings/slam_settings.h"
#include "io/text/number_text.h"
#include "tools/diagnosis/family_survey.h"
#include "tools/diagnosis/grey_image.h"
#include "tools/diagnosis/source_report.h"
#include "tools/exit_code.h"
#include "tools/number_arguments.h"
#include "tools/recorded_inputs.h"
#include "tools/run_diagnosis.h"
#include "tools/run_input.h"
#include "tools/run_record.h"
#include "tools/source_look.h"
#include "tools/stage_timer.h"

namespace waymark::tools {
namespace {

using diagnosis::Finding;
using Level = diagnosis::Finding::Level;

struct DoctorArguments {
  std::string source;
  std::string calibration;
  std::string dictionary;  // what somebody expects; empty: whatever is there
  double marker_size_m = 0.1;
  bool size_is_given = false;
  int frames = 300;
};

// Empty where no family was found.
std::optional<std::string> tellOfFamilies(const DoctorArguments& arguments, const Looked& looked) {
  const auto& images = looked.samples.images();
  const slam::CameraModel camera = diagnosis::guessedCamera(looked.info.width, looked.info.height);
  const auto families = diagnosis::surveyFamilies(images, camera);
  diagnosis::OddImages odd;
  if (families.empty()) odd = diagnosis::lookForOddImages(images, camera);
  for (const Finding& finding :
       diagnosis::familyFindings(families, odd, images.size(), arguments.dictionary)) {
    tell(finding);
  }
  if (families.empty()) return std::nullopt;
  return families.front().dictionary;
}

// What a run over these frames came to.
struct Tried {
  diagnosis::Verdict verdict;
  std::vector<double> steps_px;  // of markers from frame to frame
  diagnosis::Finding lens;
};

std::vector<double> stepsOf(const RunRecord& record) {
  std::vector<double> steps;
  std::map<int, Eigen::Vector2d> before;
  for (const slam::LiveFrame& frame : record.keptFrames()) {
    std::map<int, Eigen::Vector2d> now;
    for (const slam::MarkerDetection& marker : frame.detections) {
      Eigen::Vector2d centre = Eigen::Vector2d::Zero();
      for (const Eigen::Vector2d& corner : marker.pixels) centre += 0.25 * corner;
      if (const auto seen = before.find(marker.id); seen != before.end()) {
        steps.push_back((centre - seen->second).norm());
      }
      now.emplace(marker.id, centre);
    }
    before.swap(now);
  }
  return steps;
}

Result<Tried> tryRun(const DoctorArguments& arguments, const std::string& dictionary,
                     const std::optional<slam::Calibration>& calibration,
                     const diagnosis::ImageSamples& samples, const daemon::StopSignal& stop) {
  RunInputOptions input;
  input.source = arguments.source;
  input.calibration = arguments.calibration;
  Result<OpenedInput> opened = openRunInput(input, calibration);
  if (!opened) return opened.error();
  slam::Options options;
  options.markers.size_m = arguments.marker_size_m;
  if (!opened->lens_given) options.lens.takeForGuess(/*fov_said=*/false);
  if (opened->input->unorderedImages()) options.treatAsUnorderedImages();
  slam::Slam slam(slam::CameraModel(opened->fitted.calibration),
                  *slam::Dictionary::byName(dictionary), options);
  const auto frames = static_cast<std::size_t>(arguments.frames);
  StageTimer timer(frames);
  RunRecord record(frames);
  while (record.frames() < frames && !stop.pending()) {
    const Result<std::optional<RunInput::Step>> step = opened->input->step(slam, timer, nullptr);
    if (!step || !step.value()) break;
    record.add((*step)->time_ns, (*step)->result, slam.counters(), slam.lens().state);
  }
  const std::string who =
      arguments.calibration.empty() ? "the recording's own calibration" : arguments.calibration;
  return Tried{judgeRun(record, slam, options, dictionary, samples), stepsOf(record),
               diagnosis::lensFinding(calibration ? who : std::string(), slam.lens(),
                                      slam.camera().calibration().fx)};
}

// The lens that somebody says it is; empty when nobody does.
Result<std::optional<slam::Calibration>> lensOf(const DoctorArguments& arguments) {
  if (!arguments.calibration.empty()) {
    Result<slam::Calibration> read = io::readCalibration(arguments.calibration);
    if (!read) return read.error();
    return std::optional(*read);
  }
  Result<RecordedInputs> recorded = recordedInputs(arguments.source);
  if (!recorded) return recorded.error();
  return recorded->calibration;
}

void tellOfPoses(const Tried& tried) {
  using Grade = diagnosis::Verdict::Grade;
  const bool good = tried.verdict.grade == Grade::kGood;
  tell({good ? Level::kGood : (tried.verdict.grade == Grade::kNone ? Level::kBad : Level::kNote),
        "poses", tried.verdict.text});
  for (const std::string& advice : tried.verdict.advice) tell({Level::kNote, "poses", advice});
}

Result<ExitCode> examine(const DoctorArguments& arguments) {
  cv::setNumThreads(1);
  if (std::filesystem::path(arguments.source).extension() == ".csv") {
    return Error{arguments.source + ": recorded corners have no images to look at"};
  }
  if (const auto objection = io::validateDictionary(arguments.dictionary);
      objection && !arguments.dictionary.empty()) {
    return Error{"--dictionary: " + *objection};
  }
  const Result<std::optional<slam::Calibration>> lens = lensOf(arguments);
  if (!lens) return lens.error();
  const daemon::StopSignal stop;
  Result<std::unique_ptr<capture::FrameSource>> source = capture::openSource(arguments.source, {});
  if (!source) return Error{withPermissionHint(source.error().message)};
  const Result<Looked> looked = lookAt(**source, arguments.frames, stop);
  source->reset();  // it is opened again
  if (!looked) return looked.error();
  tellOfSource(*looked);
  const std::optional<std::string> family = tellOfFamilies(arguments, *looked);
  if (family) {
    const Result<Tried> tried = tryRun(arguments, *family, *lens, looked->samples, stop);
    if (!tried) {
      tell({Level::kBad, "lens", tried.error().message});
    } else {
      if (!looked->info.photographs) tell(diagnosis::motionFinding(tried->steps_px));
      tell(tried->lens);
      tellOfPoses(*tried);
    }
  }
  tell({Level::kNote, "scale",
        (arguments.size_is_given ? io::roundTrip(arguments.marker_size_m) + " m is taken as said"
                                 : std::string("not known")) +
            ": measure the side of a printed black square, everything is as wrong as that"});
  tellOfComputer();
  return family ? kDone : kNoPose;
}

}  // namespace

void addDoctorCommand(CLI::App& app, int* exit_code) {
  CLI::App* command =
      app.add_subcommand("doctor", "Look at a source and say what is good and what is not");
  const auto arguments = std::make_shared<DoctorArguments>();
  command
      ->add_option("source", arguments->source,
                   "A camera, a video file, a directory of images or an event log")
      ->required();
  command->add_option("--calibration", arguments->calibration,
                      "The camera's: then it is said how well it fits");
  command->add_option("--dictionary", arguments->dictionary,
                      "The family that should be there; all of them are looked for");
  CLI::Option* size = command
                          ->add_option("--marker-size", arguments->marker_size_m,
                                       "Side of the printed black square, metres")
                          ->check(numberFrom(1e-3, 100.0));
  command->add_option("--frames", arguments->frames, "Look at so many")
      ->check(wholeNumberFrom(1, 100'000))
      ->capture_default_str();
  command->callback([arguments, size, exit_code] {
    arguments->size_is_given = size->count() > 0;
    const Result<ExitCode> result = examine(*arguments);
    if (!result) std::fprintf(stderr, "waymark: %s\n", result.error().message.c_str());
    *exit_code = result ? *result : kBadInput;
  });
}

}  // namespace waymark::tools
