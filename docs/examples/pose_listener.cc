// Prints every pose that waymarkd publishes, and what a robot should look at before it trusts one.
// Needs the package libwaymark-dev, or the .lcm files and lcm-gen, and nothing of Waymark's code:
//
//   g++ pose_listener.cc $(pkg-config --cflags --libs waymark-lcmtypes) -o pose_listener
//   ./pose_listener [URL] [CHANNEL]
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <string>

#include <lcm/lcm-cpp.hpp>

#include <waymark/pose_t.hpp>

namespace {

class Listener {
 public:
  void onPose(const lcm::ReceiveBuffer* /*buffer*/, const std::string& /*channel*/,
              const waymark::pose_t* pose) {
    countGap(*pose);
    if (pose->source == waymark::pose_t::SOURCE_NONE) {
      // The old pose is still known, but it is as old as this says.
      std::printf("no pose: %s; the last one is %.2f s old\n", pose->reason.c_str(),
                  pose->had_pose ? 1e-9 * static_cast<double>(pose->last_pose_age_ns) : NAN);
      return;
    }
    // In the world, for whoever plans a way; relative to the markers in view, for whoever docks.
    std::printf("%8lld  x %7.3f  y %7.3f  z %7.3f m  +- %4.1f mm  (%4.1f in view)  %.1f ms old\n",
                static_cast<long long>(pose->sequence), pose->p_w_c[0], pose->p_w_c[1],
                pose->p_w_c[2], 1e3 * sigma(pose->covariance), 1e3 * sigma(pose->view_covariance),
                1e-6 * static_cast<double>(pose->latency_ns));
  }

 private:
  // The numbers count every frame of the camera: one that is missing was lost on the way.
  void countGap(const waymark::pose_t& pose) {
    if (pose.status == waymark::pose_t::STATUS_NO_CAMERA) return;  // no frame stands behind it
    if (last_sequence_ >= 0 && pose.sequence > last_sequence_ + 1) {
      std::printf("%lld frames were lost\n",
                  static_cast<long long>(pose.sequence - last_sequence_ - 1));
    }
    last_sequence_ = pose.sequence;
  }

  // Of the position, metres: along the direction that is known worst, roughly.
  static double sigma(const double (&covariance)[36]) {
    return std::sqrt(std::max({covariance[0], covariance[7], covariance[14]}));  // xx, yy, zz
  }

  std::int64_t last_sequence_ = -1;
};

}  // namespace

int main(int argc, char** argv) {
  lcm::LCM bus(argc > 1 ? argv[1] : "udpm://239.255.76.67:7667?ttl=0");
  if (!bus.good()) {
    std::fprintf(stderr, "pose_listener: no LCM: is there a multicast route?\n");
    return 1;
  }
  std::setvbuf(stdout, nullptr, _IOLBF, 0);
  Listener listener;
  bus.subscribe(argc > 2 ? argv[2] : "WAYMARK_POSE", &Listener::onPose, &listener);
  while (bus.handle() == 0) {
  }
  return 0;
}
