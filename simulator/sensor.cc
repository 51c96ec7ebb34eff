#include "simulator/sensor.h"

#include <algorithm>
#include <cmath>

#include "simulator/random.h"

namespace waymark::simulator {
namespace {

// Each row of each frame reads the noise from a place of its own.
constexpr std::size_t kNoiseLength = std::size_t{1} << 18;

std::vector<float> gaussianTaps(double sigma, int radius) {
  std::vector<double> taps{1.0};
  double sum = 1.0;
  for (int i = 1; i <= radius; ++i) {
    taps.push_back(std::exp(-0.5 * i * i / (sigma * sigma)));
    sum += 2.0 * taps.back();
  }
  std::vector<float> normalized;
  normalized.reserve(taps.size());
  for (const double tap : taps) normalized.push_back(static_cast<float>(tap / sum));
  return normalized;
}

}  // namespace

int Sensor::blurRadius(const Options& options) {
  return static_cast<int>(std::ceil(4.0 * options.psf_sigma_px));
}

Sensor::Sensor(const Options& options, const ImageSize& size)
    : size_(size),
      seed_(options.seed),
      taps_(gaussianTaps(options.psf_sigma_px, blurRadius(options))) {
  const double middle_x = 0.5 * (size.width - 1);
  const double middle_y = 0.5 * (size.height - 1);
  const double corner2 = middle_x * middle_x + middle_y * middle_y;
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      const double r2 = (x - middle_x) * (x - middle_x) + (y - middle_y) * (y - middle_y);
      vignetting_.push_back(static_cast<float>(1.0 - options.vignetting * r2 / corner2));
    }
  }
  if (options.noise_sigma > 0.0) {
    Random random(seed_, 0x4e4f495345);
    noise_.reserve(kNoiseLength + static_cast<std::size_t>(size.width));
    for (std::size_t i = 0; i < kNoiseLength; ++i) {
      noise_.push_back(static_cast<float>(options.noise_sigma * random.gaussian()));
    }
    for (int i = 0; i < size.width; ++i) noise_.push_back(noise_[static_cast<std::size_t>(i)]);
  }
}

void Sensor::blurRow(const Radiance& radiance, int row, Workspace* workspace) const {
  const int margin = (radiance.width - size_.width) / 2;
  const int radius = static_cast<int>(taps_.size()) - 1;
  const float* const middle = radiance.row(row + margin);
  float* const sum = workspace->column_blurred.data();
  for (int x = 0; x < radiance.width; ++x) sum[x] = taps_[0] * middle[x];
  for (int k = 1; k <= radius; ++k) {
    const float tap = taps_[static_cast<std::size_t>(k)];
    const float* const above = radiance.row(row + margin - k);
    const float* const below = radiance.row(row + margin + k);
    for (int x = 0; x < radiance.width; ++x) sum[x] += tap * (above[x] + below[x]);
  }
  float* const out = workspace->row.data();
  const float* const in = sum + margin;
  for (int x = 0; x < size_.width; ++x) out[x] = taps_[0] * in[x];
  for (int k = 1; k <= radius; ++k) {
    const float tap = taps_[static_cast<std::size_t>(k)];
    for (int x = 0; x < size_.width; ++x) out[x] += tap * (in[x - k] + in[x + k]);
  }
}

void Sensor::develop(const Radiance& radiance, float light, std::uint64_t frame,
                     Workspace* workspace, std::uint8_t* pixels) const {
  workspace->column_blurred.resize(static_cast<std::size_t>(radiance.width));
  workspace->row.resize(static_cast<std::size_t>(size_.width));
  float* const row = workspace->row.data();
  Random random(seed_, frame);
  for (int y = 0; y < size_.height; ++y) {
    blurRow(radiance, y, workspace);
    const std::size_t offset = static_cast<std::size_t>(y) * static_cast<std::size_t>(size_.width);
    const float* const vignetting = vignetting_.data() + offset;
    for (int x = 0; x < size_.width; ++x) row[x] *= light * vignetting[x];
    if (!noise_.empty()) {
      const float* const noise = noise_.data() + random.next() % kNoiseLength;
      for (int x = 0; x < size_.width; ++x) row[x] += noise[x];
    }
    std::uint8_t* const out = pixels + offset;
    for (int x = 0; x < size_.width; ++x) {
      const float to_round = std::clamp(row[x], 0.0F, 255.0F) + 0.5F;  // never negative
      out[x] = static_cast<std::uint8_t>(to_round);
    }
  }
}

int smearRadius(double length_px) {
  return std::max(0, static_cast<int>(std::ceil(0.5 * (length_px - 1.0))));
}

void smearRows(double length_px, Radiance* radiance) {
  const int radius = smearRadius(length_px);
  if (radius == 0) return;
  // Whole pixels, and at either end what is left of the length.
  const auto whole = static_cast<float>(1.0 / length_px);
  const auto end = static_cast<float>((0.5 * (length_px + 1.0) - radius) / length_px);
  std::vector<float> row(static_cast<std::size_t>(radiance->width));
  for (int y = 0; y < radiance->height; ++y) {
    float* const out = radiance->row(y);
    std::copy_n(out, radiance->width, row.begin());
    for (int x = radius; x < radiance->width - radius; ++x) {
      const float* const in = row.data() + x;
      float sum = end * (in[-radius] + in[radius]);
      for (int k = 1 - radius; k < radius; ++k) sum += whole * in[k];
      out[x] = sum;
    }
  }
}

}  // namespace waymark::simulator
