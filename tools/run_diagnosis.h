// From a run to its verdict.
#pragma once

#include "slam/options.h"
#include "slam/slam.h"
#include "tools/diagnosis/grey_image.h"
#include "tools/diagnosis/run_verdict.h"
#include "tools/run_record.h"

namespace waymark::tools {

// `samples`: some of the run's images, empty where it had none. They are looked at only where the
// run came to little, as that takes a second.
[[nodiscard]] diagnosis::Verdict judgeRun(const RunRecord& record, const slam::Slam& slam,
                                          const slam::Options& options,
                                          const std::string& dictionary,
                                          const diagnosis::ImageSamples& samples);

}  // namespace waymark::tools
