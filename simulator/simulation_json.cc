#include "simulator/simulation_json.h"

#include <nlohmann/json.hpp>

namespace waymark::simulator {
namespace {

// 0 where there are none.
double markerSize(const Scene& scene) {
  return scene.markers.empty() ? 0.0 : scene.markers.front().size_m;
}

}  // namespace

std::string optionsText(const Simulation& simulation) {
  const Options& o = simulation.options();
  const Scene& scene = simulation.scene();
  nlohmann::ordered_json json = {{"scene", scene.name},
                                 {"seed", o.seed},
                                 {"width", scene.camera.width},
                                 {"height", scene.camera.height},
                                 {"rate_hz", scene.rate_hz},
                                 {"duration_s", scene.duration_s},
                                 {"frames", simulation.frameCount()},
                                 {"dictionary", scene.dictionary.name()},
                                 {"marker_size_m", markerSize(scene)},
                                 {"markers", scene.markers.size()},
                                 {"psf_sigma_px", o.psf_sigma_px},
                                 {"noise_sigma", o.noise_sigma},
                                 {"vignetting", o.vignetting},
                                 {"exposure_s", o.exposure_s},
                                 {"exposure_samples", o.exposure_samples},
                                 {"readout_s", o.readout_s}};
  json["blackouts"] = nlohmann::json::array();
  for (const Interval& blackout : o.blackouts) {
    json["blackouts"].push_back({{"begin_s", blackout.begin_s}, {"end_s", blackout.end_s}});
  }
  json["dimmings"] = nlohmann::json::array();
  for (const Dimming& dimming : o.dimmings) {
    json["dimmings"].push_back({{"begin_s", dimming.when.begin_s},
                                {"end_s", dimming.when.end_s},
                                {"factor", dimming.factor}});
  }
  if (o.moved_marker) {
    const Eigen::Vector3d& offset = o.moved_marker->offset_m;
    json["moved_marker"] = {{"id", o.moved_marker->id},
                            {"at_s", o.moved_marker->at_s},
                            {"offset_m", {offset.x(), offset.y(), offset.z()}}};
  }
  if (!o.pictures.empty()) json["pictures"] = o.pictures.string();
  for (const Event& event : scene.events) {
    json["events"].push_back(
        {{"what", event.what}, {"begin_s", event.when.begin_s}, {"end_s", event.when.end_s}});
  }
  if (o.fisheye_deg) json["fisheye_deg"] = *o.fisheye_deg;
  if (o.refocus) json["refocus"] = {{"at_s", o.refocus->at_s}, {"factor", o.refocus->factor}};
  if (o.doubled_id) json["doubled_id"] = *o.doubled_id;
  return json.dump(1) + "\n";
}

}  // namespace waymark::simulator
