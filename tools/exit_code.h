// What the tool's exit codes mean.
#pragma once

namespace waymark::tools {

enum ExitCode {
  kDone = 0,
  kInternalError = 1,
  kIncomplete = 1,  // results were written, or frames recorded, but not all
  kRejected = 1,    // `waymark ctl`: the daemon said no, and why
  kBadInput = 2,    // bad usage too; one line on stderr says what is wrong and where
  kNoPose = 3,      // ran, but never found a pose
};

}  // namespace waymark::tools
