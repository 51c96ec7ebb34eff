// The daemon sends datagrams and has no use for TCP. systemd can allow and forbid families of
// sockets but not their kinds, so the process gives up the others itself.
#pragma once

#include "base/result.h"

namespace waymark::daemon {

// From now on this thread, and all it starts, can open no Internet sockets but UDP ones: EACCES.
// Other families stay as they are. There is no way back.
Status allowDatagramsOnly();

}  // namespace waymark::daemon
