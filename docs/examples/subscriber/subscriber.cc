// Prints poses as they come, with what libwaymark-dev installs:
//
//   g++ subscriber.cc $(pkg-config --cflags --libs waymark-lcmtypes) -o subscriber
//
#include <cstdio>
#include <string>

#include <lcm/lcm-cpp.hpp>

#include <waymark/pose_t.hpp>

struct Printer {
  void show(const lcm::ReceiveBuffer*, const std::string&, const waymark::pose_t* pose) {
    if (pose->source == waymark::pose_t::SOURCE_NONE) {
      std::printf("no pose: %s\n", pose->reason.c_str());
    } else {
      std::printf("%.3f %.3f %.3f m\n", pose->p_w_c[0], pose->p_w_c[1], pose->p_w_c[2]);
    }
  }
};

int main() {
  lcm::LCM bus("udpm://239.255.76.67:7667?ttl=0");
  if (!bus.good()) return 1;
  Printer printer;
  bus.subscribe("WAYMARK_POSE", &Printer::show, &printer);
  while (bus.handle() == 0) {
  }
}
