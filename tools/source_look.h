// What is seen of a source of images before anything is made of it, and told to people.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "base/result.h"
#include "capture/frame_source.h"
#include "daemon/control/stop_signal.h"
#include "tools/diagnosis/grey_image.h"
#include "tools/diagnosis/source_report.h"

namespace waymark::tools {

struct Looked {
  capture::StreamInfo info;
  std::vector<std::int64_t> times_ns;
  diagnosis::ImageSamples samples;
  std::string damage;  // why there are no more frames
};

// So many frames of it, or fewer. An error where there is none at all.
[[nodiscard]] Result<Looked> lookAt(capture::FrameSource& source, int frames,
                                    const daemon::StopSignal& stop);

// One line on stdout.
void tell(const diagnosis::Finding& finding);
// Source, times, light and focus.
void tellOfSource(const Looked& looked);
// The multicast route.
void tellOfComputer();

// A camera that is there and may not be opened has one usual reason.
[[nodiscard]] std::string withPermissionHint(const std::string& fault);

}  // namespace waymark::tools
