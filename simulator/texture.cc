#include "simulator/texture.h"

#include <algorithm>
#include <cmath>

#include <opencv2/imgproc.hpp>

#include "simulator/random.h"

namespace waymark::simulator {
namespace {

// Smooth noise of about unit variance at its lattice: random values `wavelength` texels apart,
// interpolated by cubics.
void addNoise(double wavelength, double amplitude, Random* random, cv::Mat* image) {
  const int columns = std::max(2, static_cast<int>(std::ceil(image->cols / wavelength)) + 1);
  const int rows = std::max(2, static_cast<int>(std::ceil(image->rows / wavelength)) + 1);
  cv::Mat lattice(rows, columns, CV_32F);
  for (int r = 0; r < rows; ++r) {
    for (int c = 0; c < columns; ++c) {
      lattice.at<float>(r, c) = static_cast<float>(amplitude * random->uniform(-1.7, 1.7));
    }
  }
  cv::Mat smooth;
  cv::resize(lattice, smooth, image->size(), 0.0, 0.0, cv::INTER_CUBIC);
  *image += smooth;
}

void fillTurned(const cv::RotatedRect& rectangle, double grey, cv::Mat* image) {
  cv::Point2f corners[4];
  rectangle.points(corners);
  cv::Point polygon[4];
  constexpr int kFractionBits = 4;
  constexpr float kUnit = 1 << kFractionBits;
  std::transform(corners, corners + 4, polygon, [](const cv::Point2f& p) {
    return cv::Point(cvRound(kUnit * p.x), cvRound(kUnit * p.y));
  });
  cv::fillConvexPoly(*image, polygon, 4, cv::Scalar::all(grey), cv::LINE_AA, kFractionBits);
}

// A paper with a few darker or lighter fields on it, as a printed page or a poster has.
void addPatch(double side, Random* random, cv::Mat* image) {
  const cv::Point2f centre(static_cast<float>(random->uniform(0.0, image->cols)),
                           static_cast<float>(random->uniform(0.0, image->rows)));
  const cv::Size2f size(static_cast<float>(side * random->uniform(0.5, 1.5)),
                        static_cast<float>(side * random->uniform(0.5, 1.5)));
  const auto degrees = static_cast<float>(random->uniform(-12.0, 12.0));
  fillTurned({centre, size, degrees}, random->uniform(70.0, 195.0), image);
  const int fields = static_cast<int>(random->uniform(0.0, 5.0));
  for (int i = 0; i < fields; ++i) {
    const cv::Point2f at(centre.x + size.width * static_cast<float>(random->uniform(-0.3, 0.3)),
                         centre.y + size.height * static_cast<float>(random->uniform(-0.3, 0.3)));
    const cv::Size2f field(size.width * static_cast<float>(random->uniform(0.1, 0.4)),
                           size.height * static_cast<float>(random->uniform(0.1, 0.4)));
    fillTurned({at, field, degrees}, random->uniform(50.0, 200.0), image);
  }
}

}  // namespace

Texture::Texture(const Surface& surface, std::uint64_t seed)
    : half_width_(static_cast<float>(surface.half_width_m)),
      half_height_(static_cast<float>(surface.half_height_m)),
      per_texel_(static_cast<float>(1.0 / surface.paint.texel_m)) {
  const Paint& paint = surface.paint;
  const auto texels = [&paint](double half_m) {
    return std::max(4, static_cast<int>(std::ceil(2.0 * half_m / paint.texel_m)));
  };
  cv::Mat image(texels(surface.half_height_m), texels(surface.half_width_m), CV_32F,
                cv::Scalar::all(paint.mean));
  Random random(seed);
  const double wavelength = paint.noise_wavelength_m / paint.texel_m;
  for (const double octave : {1.0, 0.4, 0.13}) {
    addNoise(wavelength * octave, 0.6 * paint.contrast * std::sqrt(octave), &random, &image);
  }
  cv::Mat grey;
  image.convertTo(grey, CV_8U);
  const double area = 4.0 * surface.half_width_m * surface.half_height_m;
  const int patches = static_cast<int>(std::lround(area * paint.patches_per_m2));
  for (int i = 0; i < patches; ++i) addPatch(paint.patch_size_m / paint.texel_m, &random, &grey);
  cv::GaussianBlur(grey, grey, cv::Size(), 0.8);

  width_ = static_cast<std::size_t>(grey.cols);
  last_column_ = static_cast<float>(grey.cols) - 1.001F;
  last_row_ = static_cast<float>(grey.rows) - 1.001F;
  texels_.assign(grey.datastart, grey.dataend);
}

}  // namespace waymark::simulator
