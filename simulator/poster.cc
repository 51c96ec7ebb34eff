#include "simulator/poster.h"

#include <algorithm>
#include <cmath>
#include <string>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "simulator/random.h"
#include "simulator/smooth_noise.h"

namespace waymark::simulator {
namespace {

std::string word(Random* random) {
  static constexpr const char* kSyllables[] = {"ba", "ko",  "ri", "mu",  "sel", "tan", "ver", "lo",
                                               "pi", "dra", "no", "qui", "est", "ham", "gor", "fy"};
  std::string text;
  const int syllables = 1 + static_cast<int>(random->uniform(0.0, 3.0));
  for (int i = 0; i < syllables; ++i) text += kSyllables[random->next() % 16];
  if (random->uniform(0.0, 1.0) < 0.2) text[0] = static_cast<char>(text[0] - 'a' + 'A');
  return text;
}

void writeText(const cv::Rect& box, double letter_px, double grey, Random* random, cv::Mat* image) {
  static constexpr int kFonts[] = {cv::FONT_HERSHEY_SIMPLEX, cv::FONT_HERSHEY_DUPLEX,
                                   cv::FONT_HERSHEY_COMPLEX, cv::FONT_HERSHEY_TRIPLEX};
  const int font = kFonts[random->next() % 4];
  const double scale = letter_px / 22.0;
  const int thick = std::max(1, static_cast<int>(letter_px / 14.0));
  for (double y = box.y + letter_px; y < box.y + box.height; y += 1.5 * letter_px) {
    double x = box.x;
    while (true) {
      const std::string text = word(random);
      int baseline = 0;
      const cv::Size size = cv::getTextSize(text, font, scale, thick, &baseline);
      if (x + size.width > box.x + box.width) break;
      cv::putText(*image, text, cv::Point(static_cast<int>(x), static_cast<int>(y)), font, scale,
                  cv::Scalar::all(grey), thick, cv::LINE_AA);
      x += size.width + 0.6 * letter_px;
    }
  }
}

// One shape of about `size` pixels.
void addShape(double size, Random* random, cv::Mat* image) {
  const cv::Point at(static_cast<int>(random->uniform(0.0, image->cols)),
                     static_cast<int>(random->uniform(0.0, image->rows)));
  const cv::Scalar grey = cv::Scalar::all(random->uniform(0.0, 255.0));
  const cv::Size axes(static_cast<int>(size * random->uniform(0.3, 0.6)) + 2,
                      static_cast<int>(size * random->uniform(0.2, 0.6)) + 2);
  const double turn = random->uniform(0.0, 180.0);
  switch (random->next() % 3) {
    case 0:
      cv::ellipse(*image, at, axes, turn, 0.0, 360.0, grey, cv::FILLED, cv::LINE_AA);
      return;
    case 1:
      cv::ellipse(*image, at, axes, turn, 0.0, random->uniform(90.0, 300.0), grey,
                  std::max(2, static_cast<int>(0.12 * size)), cv::LINE_AA);
      return;
    default:
      break;
  }
  cv::Point polygon[5];
  const int corners = 3 + static_cast<int>(random->next() % 3);
  for (int i = 0; i < corners; ++i) {
    const double angle = 2.0 * CV_PI * (i + random->uniform(0.0, 0.7)) / corners;
    const double radius = size * random->uniform(0.3, 0.6);
    polygon[i] = at + cv::Point(static_cast<int>(radius * std::cos(angle)),
                                static_cast<int>(radius * std::sin(angle)));
  }
  cv::fillPoly(*image, std::vector<std::vector<cv::Point>>{{polygon, polygon + corners}}, grey,
               cv::LINE_AA);
}

cv::Mat textPoster(const cv::Size& size, Random* random) {
  cv::Mat image(size, CV_8U, cv::Scalar::all(random->uniform(200.0, 250.0)));
  const int margin = size.width / 16;
  const int inner = size.width - 2 * margin;
  writeText({margin, margin, inner, size.height / 6}, size.width / 11.0, random->uniform(0.0, 60.0),
            random, &image);
  cv::Mat picture;
  const cv::Rect frame(margin, size.height / 5, inner, size.height / 3);
  clouds(frame.size(), 0.4 * size.width, 70.0, 0.6, random)
      .convertTo(picture, CV_8U, 1.0, random->uniform(90.0, 150.0));
  for (int i = 0; i < 9; ++i) addShape(inner * random->uniform(0.05, 0.3), random, &picture);
  picture.copyTo(image(frame));
  const int below = frame.y + frame.height + margin / 2;
  writeText({margin, below, inner, size.height - below - margin}, size.width / 40.0,
            random->uniform(10.0, 70.0), random, &image);
  return image;
}

cv::Mat shapesPoster(const cv::Size& size, Random* random) {
  cv::Mat image(size, CV_8U, cv::Scalar::all(random->uniform(60.0, 220.0)));
  double side = 0.6 * size.width;
  for (int i = 0; i < 110; ++i, side *= 0.965) addShape(side, random, &image);
  return image;
}

cv::Mat photoPoster(const cv::Size& size, Random* random) {
  cv::Mat light = clouds(size, 0.7 * size.width, 60.0, 0.55, random);
  cv::Mat image;
  light.convertTo(image, CV_8U, 1.0, random->uniform(90.0, 150.0));
  double side = 0.5 * size.width;
  for (int i = 0; i < 45; ++i, side *= 0.93) addShape(side, random, &image);
  cv::GaussianBlur(image, image, cv::Size(), 1.2);
  cv::Mat shaded;
  image.convertTo(shaded, CV_32F);
  shaded += clouds(size, 0.15 * size.width, 25.0, 0.75, random);
  shaded.convertTo(image, CV_8U);
  return image;
}

}  // namespace

PosterImage makePoster(PosterStyle style, std::uint64_t seed, int width, int height) {
  Random random(seed, 0x504f53);
  const cv::Size size(width, height);
  cv::Mat image;
  switch (style) {
    case PosterStyle::kText:
      image = textPoster(size, &random);
      break;
    case PosterStyle::kShapes:
      image = shapesPoster(size, &random);
      break;
    case PosterStyle::kPhoto:
      image = photoPoster(size, &random);
      break;
  }
  return {width, height, {image.datastart, image.dataend}};
}

PosterImage makePoster(std::uint64_t seed, int width, int height) {
  Random random(seed, 0x5354594c45);
  return makePoster(static_cast<PosterStyle>(random.next() % 3), seed, width, height);
}

}  // namespace waymark::simulator
