// The timestamp of a V4L2 buffer and what its flags say of it.
#pragma once

#include <cstdint>

#include <linux/videodev2.h>

#include "capture/mid_exposure.h"

namespace waymark::capture::v4l2 {

[[nodiscard]] inline DriverTime driverTime(std::uint32_t flags, const timeval& timestamp) {
  if ((flags & V4L2_BUF_FLAG_TIMESTAMP_MASK) != V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC) return {};
  const bool start = (flags & V4L2_BUF_FLAG_TSTAMP_SRC_MASK) == V4L2_BUF_FLAG_TSTAMP_SRC_SOE;
  return {
      .ns = 1'000'000'000 * static_cast<std::int64_t>(timestamp.tv_sec) +
            1000 * static_cast<std::int64_t>(timestamp.tv_usec),
      .meaning = start ? DriverTime::Meaning::kStartOfExposure : DriverTime::Meaning::kEndOfFrame};
}

}  // namespace waymark::capture::v4l2
