// SIGHUP as a file to read.
#pragma once

#include "base/unique_fd.h"

namespace waymark::daemon {

class ReloadSignal {
 public:
  // Blocks SIGHUP in this thread and in all it starts from now on.
  ReloadSignal();

  // Readable when the signal has come.
  [[nodiscard]] int fd() const { return signals_.get(); }
  // Has it come since the last call? Never waits.
  [[nodiscard]] bool take() const;

 private:
  UniqueFd signals_;
};

}  // namespace waymark::daemon
