#include "simulator/interior.h"

#include <algorithm>
#include <cmath>
#include <string>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "base/image_view.h"
#include "simulator/smooth_noise.h"

namespace waymark::simulator {
namespace {

constexpr double kTexel = 0.004;  // metres

// A rectangular surface to draw on: x to the right and y up from its bottom-left corner, metres.
class Drawing {
 public:
  Drawing(double width_m, double height_m, double grey)
      : image_(texels(height_m), texels(width_m), CV_8U, cv::Scalar::all(grey)),
        width_m_(width_m),
        height_m_(height_m) {}

  [[nodiscard]] double width() const { return width_m_; }
  [[nodiscard]] double height() const { return height_m_; }

  void rectangle(double left, double bottom, double right, double top, double grey) {
    const cv::Point corners[4] = {point(left, bottom), point(right, bottom), point(right, top),
                                  point(left, top)};
    cv::fillConvexPoly(image_, corners, 4, cv::Scalar::all(grey), cv::LINE_AA, kFractionBits);
  }
  // Of `wide_m`, its outer edge as given.
  void frame(double left, double bottom, double right, double top, double wide_m, double grey) {
    rectangle(left, bottom, left + wide_m, top, grey);
    rectangle(right - wide_m, bottom, right, top, grey);
    rectangle(left, top - wide_m, right, top, grey);
    rectangle(left, bottom, right, bottom + wide_m, grey);
  }
  void line(double x0, double y0, double x1, double y1, double wide_m, double grey) {
    cv::line(image_, point(x0, y0), point(x1, y1), cv::Scalar::all(grey),
             std::max(1, static_cast<int>(std::lround(wide_m / kTexel))), cv::LINE_AA,
             kFractionBits);
  }
  void spot(double x, double y, double radius_x, double radius_y, double turn_deg, double grey) {
    const auto length = [](double m) {
      return std::max(1, static_cast<int>(std::lround(m / kTexel * kUnit)));
    };
    // ellipse() has no sub-pixel form for angles; polygons have.
    std::vector<cv::Point> outline;
    cv::ellipse2Poly(cv::Point(0, 0), cv::Size(length(radius_x), length(radius_y)),
                     static_cast<int>(turn_deg), 0, 360, 15, outline);
    const cv::Point middle = point(x, y);
    for (cv::Point& p : outline) p += middle;
    cv::fillConvexPoly(image_, outline, cv::Scalar::all(grey), cv::LINE_AA, kFractionBits);
  }
  void text(double left, double bottom, double letter_m, const std::string& text, double grey) {
    const cv::Point at = point(left, bottom);
    cv::putText(image_, text, cv::Point(at.x / kUnit, at.y / kUnit), cv::FONT_HERSHEY_SIMPLEX,
                letter_m / kTexel / 22.0, cv::Scalar::all(grey), 1, cv::LINE_AA);
  }

  // Light and dirt: factors of 1 -+ `share`, `longest_m` apart and finer.
  void shade(double share, double longest_m, double fall, Random* random) {
    cv::Mat light;
    image_.convertTo(light, CV_32F);
    light = light.mul(1.0 + clouds(image_.size(), longest_m / kTexel, share, fall, random));
    light.convertTo(image_, CV_8U);
  }
  // Darker towards the bottom, by `share`.
  void shadeDown(double share) {
    for (int r = 0; r < image_.rows; ++r) {
      const double down = static_cast<double>(r) / image_.rows;
      cv::Mat row = image_.row(r);
      row.convertTo(row, CV_8U, 1.0 - share * down * down);
    }
  }

  [[nodiscard]] SharedImage finished() const {
    cv::Mat smooth;
    cv::GaussianBlur(image_, smooth, cv::Size(), 0.7);
    const ImageView view{smooth.data, smooth.cols, smooth.rows, smooth.cols};
    return std::make_shared<PrintedImage>(view, 0.0, 255.0);
  }

 private:
  static constexpr int kFractionBits = 4;
  static constexpr int kUnit = 1 << kFractionBits;

  static int texels(double length_m) {
    return std::max(4, static_cast<int>(std::lround(length_m / kTexel)));
  }
  [[nodiscard]] cv::Point point(double x, double y) const {
    return {cvRound(kUnit * (x / kTexel - 0.5)), cvRound(kUnit * ((height_m_ - y) / kTexel - 0.5))};
  }

  cv::Mat image_;
  double width_m_;
  double height_m_;
};

void drawDoor(double middle, Random* random, Drawing* wall) {
  constexpr double kHalfLeaf = 0.45;
  constexpr double kTop = 2.06;
  const double leaf = random->uniform(95.0, 165.0);
  const double frame = random->uniform(60.0, 120.0);
  const double left = middle - kHalfLeaf;
  const double right = middle + kHalfLeaf;
  wall->rectangle(left - 0.07, 0.0, right + 0.07, kTop + 0.07, frame);
  wall->rectangle(left - 0.015, 0.0, right + 0.015, kTop + 0.015, 40.0);  // the gap's shadow
  wall->rectangle(left, 0.01, right, kTop, leaf);
  wall->rectangle(left, 0.01, right, 0.22, leaf - 25.0);  // kicking plate
  if (random->uniform(0.0, 1.0) < 0.4) {                  // a pane
    wall->rectangle(left + 0.25, 1.15, right - 0.25, 1.85, leaf - 45.0);
    wall->rectangle(left + 0.27, 1.17, right - 0.27, 1.83, 55.0);
    wall->line(left + 0.30, 1.25, left + 0.52, 1.75, 0.012, 110.0);
  }
  // The handle on its plate, on one side; hinges on the other.
  const double side = random->uniform(0.0, 1.0) < 0.5 ? 1.0 : -1.0;
  const double handle = middle + side * (kHalfLeaf - 0.07);
  wall->rectangle(handle - 0.02, 0.93, handle + 0.02, 1.13, 200.0);
  wall->line(handle, 1.07, handle - side * 0.12, 1.07, 0.018, 225.0);
  wall->spot(handle, 0.97, 0.008, 0.008, 0.0, 30.0);
  const double hinges = middle - side * (kHalfLeaf + 0.012);
  for (const double y : {0.25, 1.0, 1.8}) {
    wall->rectangle(hinges - 0.01, y, hinges + 0.01, y + 0.09, 190.0);
  }
  // The plate beside it: a number, a name or two.
  const double plate = middle + side * (kHalfLeaf + 0.16) - (side > 0.0 ? 0.0 : 0.20);
  wall->rectangle(plate, 1.45, plate + 0.20, 1.62, 215.0);
  wall->frame(plate, 1.45, plate + 0.20, 1.62, 0.006, 90.0);
  wall->text(plate + 0.02, 1.55, 0.045, std::to_string(100 + random->next() % 300), 35.0);
  for (const double y : {1.52, 1.485}) {
    wall->line(plate + 0.02, y, plate + random->uniform(0.08, 0.18), y, 0.008, 80.0);
  }
}

void drawWindow(double middle, Random* random, Drawing* wall) {
  constexpr double kHalf = 0.70;
  const double left = middle - kHalf;
  const double right = middle + kHalf;
  wall->rectangle(left - 0.06, 0.86, right + 0.06, 2.31, 210.0);  // frame and sill
  wall->rectangle(left - 0.10, 0.82, right + 0.10, 0.87, 150.0);
  for (const double l : {left, middle + 0.03}) {
    const double r = l + kHalf - 0.03;
    wall->rectangle(l, 0.92, r, 2.25, 235.0);  // a bright sky
    double x = l;
    while (x < r) {  // houses across the street
      const double next = std::min(r, x + random->uniform(0.12, 0.35));
      const double roof = random->uniform(1.2, 1.75);
      const double grey = random->uniform(120.0, 200.0);
      wall->rectangle(x, 0.92, next, roof, grey);
      for (double y = 1.0; y < roof - 0.08; y += 0.11) {
        for (double w = x + 0.03; w < next - 0.05; w += 0.08) {
          wall->rectangle(w, y, w + 0.04, y + 0.06, grey - 55.0);
        }
      }
      x = next;
    }
    wall->frame(l, 0.92, r, 2.25, 0.03, 190.0);
  }
  wall->rectangle(middle - 0.06, 1.5, middle - 0.035, 1.62, 90.0);  // the handle
  // The radiator below.
  wall->rectangle(left + 0.1, 0.15, right - 0.1, 0.70, 195.0);
  for (double x = left + 0.13; x < right - 0.12; x += 0.06) {
    wall->line(x, 0.18, x, 0.67, 0.012, 150.0);
  }
  wall->spot(right - 0.06, 0.62, 0.035, 0.03, 0.0, 225.0);  // its valve
}

// Whether something of half that width may be drawn at x.
bool isFree(const WallLook& look, double x, double half_m) {
  const auto apart = [&](double from, double by) { return std::abs(x - from) > by + half_m; };
  return x > half_m && x < look.width_m - half_m &&
         std::ranges::all_of(look.doors_m, [&](double d) { return apart(d, 0.8); }) &&
         std::ranges::all_of(look.windows_m, [&](double d) { return apart(d, 0.85); });
}

void drawFittings(const WallLook& look, Random* random, Drawing* wall) {
  for (double x = random->uniform(0.2, 1.0); x < look.width_m; x += random->uniform(0.9, 2.6)) {
    if (!isFree(look, x, 0.1)) continue;
    switch (random->next() % 4) {
      case 0: {  // sockets
        const int count = 1 + static_cast<int>(random->next() % 3);
        for (int i = 0; i < count; ++i) {
          const double at = x + 0.075 * i;
          wall->rectangle(at - 0.037, 0.26, at + 0.037, 0.334, 222.0);
          wall->frame(at - 0.037, 0.26, at + 0.037, 0.334, 0.005, 140.0);
          wall->spot(at, 0.297, 0.022, 0.022, 0.0, 165.0);
          wall->spot(at - 0.01, 0.297, 0.005, 0.005, 0.0, 50.0);
          wall->spot(at + 0.01, 0.297, 0.005, 0.005, 0.0, 50.0);
        }
        break;
      }
      case 1:  // a switch
        wall->rectangle(x - 0.04, 1.02, x + 0.04, 1.10, 225.0);
        wall->frame(x - 0.04, 1.02, x + 0.04, 1.10, 0.006, 145.0);
        wall->line(x - 0.025, 1.06, x + 0.025, 1.06, 0.005, 120.0);
        break;
      case 2: {  // a way out, or a fire extinguisher's sign
        const double y = random->uniform(1.75, 2.05);
        wall->rectangle(x - 0.075, y, x + 0.075, y + 0.15, 70.0);
        wall->rectangle(x - 0.05, y + 0.02, x - 0.015, y + 0.11, 215.0);
        wall->line(x - 0.005, y + 0.075, x + 0.05, y + 0.075, 0.014, 215.0);
        wall->line(x + 0.025, y + 0.105, x + 0.055, y + 0.075, 0.014, 215.0);
        wall->line(x + 0.025, y + 0.045, x + 0.055, y + 0.075, 0.014, 215.0);
        break;
      }
      default: {  // a cable's duct down to the skirting
        const double y = random->uniform(1.1, look.height_m);
        wall->rectangle(x - 0.015, 0.1, x + 0.015, y, look.grey + 18.0);
        wall->line(x + 0.017, 0.1, x + 0.017, y, 0.004, look.grey - 45.0);
        break;
      }
    }
  }
}

// What shoes, bags, chairs, adhesive tape and drawing pins have left.
void drawScuffs(const WallLook& look, Random* random, Drawing* wall) {
  const int count = static_cast<int>(std::lround(4.0 * look.width_m));
  for (int i = 0; i < count; ++i) {
    const double x = random->uniform(0.0, look.width_m);
    const double y = random->uniform(0.0, 1.0) < 0.6 ? random->uniform(0.1, 1.0)
                                                     : random->uniform(1.0, look.height_m - 0.2);
    const double grey = look.grey + random->uniform(-60.0, 15.0);
    if (random->uniform(0.0, 1.0) < 0.5) {
      wall->line(x, y, x + random->uniform(-0.15, 0.15), y + random->uniform(-0.03, 0.03), 0.004,
                 grey);
    } else {
      wall->spot(x, y, random->uniform(0.004, 0.025), random->uniform(0.004, 0.015),
                 random->uniform(0.0, 180.0), grey);
    }
  }
}

void drawBooks(double left, double right, double bottom, double top, Random* random,
               Drawing* shelf) {
  for (double x = left; x < right - 0.02;) {
    if (random->uniform(0.0, 1.0) < 0.07) {
      x += random->uniform(0.04, 0.2);  // a gap, dark
      continue;
    }
    const double width = std::min(random->uniform(0.015, 0.075), right - x);
    const double height = (top - bottom) * random->uniform(0.6, 0.95);
    const double grey = random->uniform(45.0, 215.0);
    shelf->rectangle(x, bottom, x + width - 0.002, bottom + height, grey);
    const double ink = grey > 130.0 ? grey - 90.0 : grey + 90.0;
    if (width > 0.05) {  // a file with its label and hole
      shelf->rectangle(x + 0.008, bottom + 0.45 * height, x + width - 0.010, bottom + 0.85 * height,
                       215.0);
      for (const double y : {0.55, 0.65, 0.75}) {
        shelf->line(x + 0.016, bottom + y * height, x + width - 0.020, bottom + y * height, 0.006,
                    70.0);
      }
      shelf->spot(x + 0.5 * width, bottom + 0.2 * height, 0.014, 0.014, 0.0, 30.0);
    } else {
      const double from = random->uniform(0.1, 0.4);
      const double to = random->uniform(0.5, 0.9);
      shelf->rectangle(x + 0.3 * width, bottom + from * height, x + 0.65 * width,
                       bottom + to * height, ink);
    }
    x += width;
  }
}

}  // namespace

SharedImage wallImage(const WallLook& look, Random* random) {
  Drawing wall(look.width_m, look.height_m, look.grey);
  if (look.dado) {
    wall.rectangle(0.0, 0.0, look.width_m, 1.0, look.grey - 45.0);
    wall.rectangle(0.0, 0.99, look.width_m, 1.03, look.grey - 75.0);
  }
  drawScuffs(look, random, &wall);
  wall.rectangle(0.0, 0.0, look.width_m, 0.09, 85.0);  // skirting
  wall.rectangle(0.0, 0.083, look.width_m, 0.09, 140.0);
  wall.shadeDown(0.10);
  wall.shade(0.05, 2.5, 0.35, random);
  for (const double door : look.doors_m) drawDoor(door, random, &wall);
  for (const double window : look.windows_m) drawWindow(window, random, &wall);
  drawFittings(look, random, &wall);
  return wall.finished();
}

SharedImage floorImage(double width_m, double height_m, Random* random) {
  Drawing floor(width_m, height_m, 112.0);
  const auto marks = static_cast<int>(std::lround(14.0 * width_m * height_m));
  for (int i = 0; i < marks; ++i) {
    const double x = random->uniform(0.0, width_m);
    const double y = random->uniform(0.0, height_m);
    const double grey = 112.0 + random->uniform(-45.0, 40.0);
    if (random->uniform(0.0, 1.0) < 0.4) {
      floor.line(x, y, x + random->uniform(-0.2, 0.2), y + random->uniform(-0.2, 0.2), 0.004, grey);
    } else {
      floor.spot(x, y, random->uniform(0.006, 0.035), random->uniform(0.006, 0.02),
                 random->uniform(0.0, 180.0), grey);
    }
  }
  // Sheets along the longer side.
  const bool along_x = width_m > height_m;
  for (double at = 0.5; at < std::min(width_m, height_m); at += 1.5) {
    if (along_x) {
      floor.line(0.0, at, width_m, at, 0.008, 70.0);
    } else {
      floor.line(at, 0.0, at, height_m, 0.008, 70.0);
    }
  }
  floor.shade(0.10, 1.5, 0.6, random);
  return floor.finished();
}

SharedImage ceilingImage(double width_m, double height_m, Random* random) {
  constexpr double kPanel = 0.6;
  Drawing ceiling(width_m, height_m, 178.0);
  for (double y = 0.0; y < height_m; y += kPanel) {
    for (double x = 0.0; x < width_m; x += kPanel) {
      const double right = std::min(x + kPanel, width_m);
      const double top = std::min(y + kPanel, height_m);
      ceiling.rectangle(x, y, right, top, 178.0 + random->uniform(-5.0, 5.0));
      const double kind = random->uniform(0.0, 1.0);
      if (kind < 0.07) {  // a lamp
        ceiling.rectangle(x + 0.03, y + 0.03, right - 0.03, top - 0.03, 245.0);
        ceiling.line(x + 0.3, y + 0.03, x + 0.3, top - 0.03, 0.02, 205.0);
      } else if (kind < 0.11) {  // a vent
        for (double v = y + 0.08; v < top - 0.05; v += 0.05) {
          ceiling.line(x + 0.06, v, right - 0.06, v, 0.016, 105.0);
        }
      } else if (kind < 0.16) {  // water has been here
        ceiling.spot(x + random->uniform(0.1, 0.5), y + random->uniform(0.1, 0.5),
                     random->uniform(0.04, 0.2), random->uniform(0.04, 0.12),
                     random->uniform(0.0, 180.0), 155.0);
      } else if (kind < 0.20) {  // a smoke detector
        ceiling.spot(x + 0.3, y + 0.3, 0.055, 0.055, 0.0, 215.0);
        ceiling.spot(x + 0.3, y + 0.3, 0.02, 0.02, 0.0, 120.0);
      }
      ceiling.frame(x, y, right, top, 0.008, 140.0);
    }
  }
  ceiling.shade(0.05, 2.0, 0.5, random);
  return ceiling.finished();
}

SharedImage shelfImage(double width_m, double height_m, Random* random) {
  constexpr double kBoard = 0.022;
  Drawing shelf(width_m, height_m, 150.0);
  for (double y = 0.08; y < height_m - 0.2; y += 0.36) {
    const double top = std::min(y + 0.36 - kBoard, height_m - kBoard);
    shelf.rectangle(kBoard, y, width_m - kBoard, top, 38.0);
    drawBooks(kBoard, width_m - kBoard, y, top, random, &shelf);
  }
  shelf.shade(0.06, 0.5, 0.5, random);
  return shelf.finished();
}

SharedImage materialImage(double width_m, double height_m, double grey, double contrast,
                          Random* random) {
  Drawing material(width_m, height_m, grey);
  material.shade(contrast / grey, 0.25, 0.65, random);
  return material.finished();
}

}  // namespace waymark::simulator
