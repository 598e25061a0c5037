#include "metrics/touches.h"

#include <algorithm>
#include <nlohmann/json.hpp>

namespace haptrace {

std::vector<TouchFigures> touch_figures(const RecordingReader& reader,
                                        const std::function<void(const ContactSample&)>& each) {
  constexpr std::uint64_t kBlock = 8192;  // rows
  const std::uint64_t rows = reader.contact_rows();
  const RecordingHeader header = reader.header();
  if (rows == 0) return {};
  std::vector<TouchFigures> figures;
  for (const std::string& name : header.scene.objects) figures.push_back({.name = name});
  std::vector<double> last(figures.size(), kNaN);
  const double period = header.rate_hz > 0 ? 1 / header.rate_hz : 0;
  for (std::uint64_t first = 0; first < rows; first += kBlock) {
    for (const ContactSample& contact : reader.contacts(first, kBlock)) {
      if (each) each(contact);
      if (contact.object >= figures.size() || !(contact.depth > 0)) continue;
      TouchFigures& figure = figures[contact.object];
      const double time = 1e-9 * static_cast<double>(contact.time_ns);
      // A contact at consecutive ticks lasts from one to the next; the first one of a touch lasts a tick.
      const double since = time - last[contact.object];
      if (!(since < TouchFigures::kLeft)) ++figure.times;
      figure.seconds += since < 1.5 * period ? since : period;
      figure.max_force = std::max(figure.max_force, contact.force.norm());
      figure.max_depth = std::max(figure.max_depth, contact.depth);
      last[contact.object] = time;
    }
  }
  return figures;
}

nlohmann::json json_of(std::span<const TouchFigures> touches) {
  nlohmann::json json = nlohmann::json::array();
  for (const TouchFigures& touch : touches)
    json.push_back({{"object", touch.name},
                    {"times", touch.times},
                    {"seconds", touch.seconds},
                    {"max_force_n", touch.max_force},
                    {"max_depth_m", touch.max_depth}});
  return json;
}

}  // namespace haptrace
