// SIGTERM and SIGINT as something to wait for, instead of handlers in which nothing may be done.
#pragma once

#include "base/unique_fd.h"

namespace waymark::daemon {

class StopSignal {
 public:
  // Blocks both signals in this thread and in all it starts from now on.
  StopSignal();

  // Returns when one of the signals has come, or finish() was called.
  void wait();

  // Has one of them come already?
  [[nodiscard]] bool pending() const;

  // Any thread.
  void finish();

  // Both end the process again, as if this had never been: in this thread.
  static void release();

 private:
  [[nodiscard]] bool poll(int timeout_ms) const;

  UniqueFd signals_;
  UniqueFd finished_;
};

}  // namespace waymark::daemon
