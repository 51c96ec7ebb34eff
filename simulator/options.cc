#include "simulator/options.h"

#include <cmath>

namespace waymark::simulator {
namespace {

// Larger images are a mistyped size, not a camera.
constexpr int kSmallestSide = 32;
constexpr int kLargestSide = 8192;
constexpr int kMaxExposureSamples = 256;
constexpr double kMaxFrames = 10e6;

// Not NaN, not infinite, within the bounds.
bool within(double value, double low, double high) { return value >= low && value <= high; }

bool valid(const Interval& interval) {
  return std::isfinite(interval.begin_s) && std::isfinite(interval.end_s) &&
         interval.begin_s < interval.end_s;
}

std::string invalidStream(const Options& o) {
  if (o.size && (o.size->width < kSmallestSide || o.size->height < kSmallestSide ||
                 o.size->width > kLargestSide || o.size->height > kLargestSide)) {
    return "image size must be 32 to 8192 pixels a side";
  }
  if (o.rate_hz && !within(*o.rate_hz, 0.1, 1000.0)) return "rate must be 0.1 to 1000 Hz";
  if (o.duration_s && !(within(*o.duration_s, 1e-3, kMaxFrames))) {
    return "duration must be a positive number of seconds";
  }
  if (o.marker_size_m && !within(*o.marker_size_m, 1e-3, 10.0)) {
    return "marker size must be 0.001 to 10 metres";
  }
  return {};
}

std::string invalidCamera(const Options& o) {
  if (!within(o.psf_sigma_px, 0.0, 5.0)) return "PSF sigma must be 0 to 5 pixels";
  if (!within(o.noise_sigma, 0.0, 100.0)) return "noise sigma must be 0 to 100 grey levels";
  if (!within(o.vignetting, 0.0, 1.0)) return "vignetting must be 0 to 1";
  if (!within(o.exposure_s, 0.0, 1.0)) return "exposure must be 0 to 1 second";
  if (o.fisheye_deg && !within(*o.fisheye_deg, 20.0, 170.0)) {
    return "a fisheye's field of view must be 20 to 170 degrees";
  }
  if (o.refocus && !(std::isfinite(o.refocus->at_s) && within(o.refocus->factor, 0.5, 2.0))) {
    return "a change of focus needs a finite time, and a factor of 0.5 to 2";
  }
  if (!within(o.readout_s, 0.0, 1.0)) return "readout time must be 0 to 1 second";
  if (o.exposure_samples < 1 || o.exposure_samples > kMaxExposureSamples) {
    return "exposure samples must be 1 to 256";
  }
  return {};
}

std::string invalidEvents(const Options& o) {
  for (const Interval& blackout : o.blackouts) {
    if (!valid(blackout)) return "a blackout must begin before it ends";
  }
  for (const Dimming& dimming : o.dimmings) {
    if (!valid(dimming.when)) return "a dimming must begin before it ends";
    if (!within(dimming.factor, 0.0, 1.0)) return "a dimming's factor must be 0 to 1";
  }
  if (o.moved_marker &&
      (!std::isfinite(o.moved_marker->at_s) || !o.moved_marker->offset_m.allFinite())) {
    return "a moved marker needs a finite time and offset";
  }
  return {};
}

}  // namespace

std::string Options::invalidReason() const {
  for (const auto check : {invalidStream, invalidCamera, invalidEvents}) {
    if (std::string reason = check(*this); !reason.empty()) return reason;
  }
  return {};
}

}  // namespace waymark::simulator
