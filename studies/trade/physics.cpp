#include "studies/trade/physics.h"

#include <algorithm>
#include <cmath>

namespace haptrace {

const std::vector<PhysicsPart>& physics_parts() {
  using S = SimSpec;
  static const std::vector<PhysicsPart> parts{
      {"force resolution", [](const S& s) { return s.force_resolution > 0; }, [](S& s) { s.force_resolution = 0; }},
      {"delay", [](const S& s) { return s.delay > 0; }, [](S& s) { s.delay = 0; }},
      {"motor's lag", [](const S& s) { return s.actuator_bandwidth_hz > 0; },
       [](S& s) { s.actuator_bandwidth_hz = 0; }},
      {"viscous friction", [](const S& s) { return !s.viscous.isZero(0); }, [](S& s) { s.viscous.setZero(); }},
      {"dry friction", [](const S& s) { return !s.coulomb.isZero(0); },
       [](S& s) {
         s.coulomb.setZero();
         s.presliding_stiffness.setZero();
         s.presliding_damping = 0;
         s.static_ratio = 1;
       }},
      {"presliding", [](const S& s) { return !s.presliding_stiffness.isZero(0); },
       [](S& s) {
         s.presliding_stiffness.setZero();
         s.presliding_damping = 0;
       }},
      {"static friction", [](const S& s) { return s.static_ratio > 1; }, [](S& s) { s.static_ratio = 1; }},
      {"gravity", [](const S& s) { return !s.gravity_bias.isZero(0); }, [](S& s) { s.gravity_bias.setZero(); }},
      {"gravity's gradient", [](const S& s) { return !s.gravity_gradient.isZero(0); },
       [](S& s) { s.gravity_gradient.setZero(); }},
      {"cogging", [](const S& s) { return !s.cogging.isZero(0); },
       [](S& s) {
         s.cogging.setZero();
         s.cogging_period = 0;
       }},
      {"structural mode", [](const S& s) { return s.structural_mode.has_value(); },
       [](S& s) {
         s.structural_mode.reset();
         s.backlash = 0;
       }},
      {"backlash", [](const S& s) { return s.backlash > 0; }, [](S& s) { s.backlash = 0; }},
      {"position resolution", [](const S& s) { return s.position_resolution > 0; },
       [](S& s) { s.position_resolution = 0; }},
      {"position noise", [](const S& s) { return s.position_noise > 0; }, [](S& s) { s.position_noise = 0; }},
      {"hand", [](const S& s) { return s.hand.has_value(); }, [](S& s) { s.hand.reset(); }},
      {"arm behind the hand", [](const S& s) { return s.hand && s.hand->arm_stiffness > 0; },
       [](S& s) { s.hand->arm_stiffness = s.hand->arm_relaxation = s.hand->arm_damping = 0; }},
      {"tremor", [](const S& s) { return s.hand && s.hand->tremor > 0; }, [](S& s) { s.hand->tremor = 0; }},
      {"drift of the hand", [](const S& s) { return s.hand && s.hand->drift > 0; }, [](S& s) { s.hand->drift = 0; }}};
  return parts;
}

Explanation explain_physics(const Workplace& place, const SimSpec& spec,
                            const std::function<std::unique_ptr<Device>(const SimSpec& spec, std::uint64_t seed)>& make,
                            const Configuration& configuration, const Budget& budget, const TradeOptions& options,
                            const StopRequest& stop) {
  const auto measured = [&](const SimSpec& one) {
    Workplace at = place;
    at.open = [&](std::uint64_t seed) { return make(one, seed); };
    const Workbench bench(at);
    Outcome outcome = bench.judge(configuration, options.runs);
    bench.time_ticks(outcome);
    return outcome;
  };
  Explanation explanation{.of = measured(spec), .terms = {}};
  for (const PhysicsPart& part : physics_parts()) {
    if (stop.count() > 0) break;
    if (!part.there(spec)) continue;
    SimSpec without = spec;
    part.leave_out(without);
    TermPrice price{.term = part.name, .without = measured(without)};
    weigh(explanation.of, budget, price);
    price.control = explanation.of.tick - price.without.tick;
    explanation.terms.push_back(std::move(price));
  }
  return explanation;
}

}  // namespace haptrace
