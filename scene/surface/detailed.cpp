#include "scene/surface/detailed.h"

#include "base/error.h"
#include "control/norm.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <numbers>
#include <utility>

namespace haptrace {
namespace {

constexpr double kHandSpeed = 0.1;        // of an exploring hand [m/s]
constexpr double kSlowVibration = 10;     // slower ones are no vibration for the monitor [Hz]
constexpr double kMostAdhesion = 100;     // [N]
constexpr double kDefaultBristle = 1000;  // where the surface has no one stiffness [N/m]

/// Parts of a surface, as bits.
enum Part : unsigned { kLaw = 1, kShading = 2, kFriction = 4, kTexture = 8, kAdhesion = 16, kAllParts = 32 };

/// A surface with the given parts. Each combination is compiled by itself, so that a part that is absent costs nothing.
template <unsigned Parts>
class Detailed final : public Surface {
 public:
  explicit Detailed(DetailedSpec spec) : spec_(std::move(spec)) {}

  void prepare(const SceneTiming& timing) override {
    rate_hz_ = timing.rate_hz;
    resolution_ = timing.resolution;
    ahead_ = spec_.elastic.lead / timing.rate_hz;
    if constexpr ((Parts & kTexture) != 0) spec_.texture.height->prepare();
  }

  [[nodiscard]] double reach() const noexcept override {
    if constexpr ((Parts & kAdhesion) != 0) return spec_.adhesion->force / spec_.adhesion->stiffness;
    return 0;
  }

  [[nodiscard]] Contact press(const Press& press, SurfaceMemory& memory) const noexcept override {
    const Proxy& proxy = press.proxy;
    Contact contact{.place = press.step.to,
                    .proxy = proxy.position,
                    .normal = proxy.normal,
                    .depth = proxy.depth,
                    .stiffness = spec_.elastic.stiffness,
                    .damping = spec_.elastic.damping};
    if (!proxy.touching) return contact;
    if constexpr ((Parts & kAdhesion) != 0)
      if (proxy.depth <= 0) return adhere(contact);

    Vec3 direction = proxy.normal;
    if constexpr ((Parts & kShading) != 0) direction = press.shape.smooth(proxy, *spec_.crease);
    // A texture turns the direction.
    // NOLINTNEXTLINE(performance-unnecessary-copy-initialization)
    const Vec3 normal = direction;
    double depth = proxy.depth;
    if constexpr ((Parts & kTexture) != 0) raise(press, depth, direction, contact.vibration);
    const Elastic elastic = depth > 0 ? spring(depth) : Elastic{};
    contact.force = elastic.force * direction;
    contact.stored = elastic.stored;
    contact.stiffness = elastic.stiffness;
    if constexpr ((Parts & kTexture) != 0) contact.vibration *= elastic.force;
    contact.force += spec_.elastic.damping * std::max(0.0, -press.velocity.dot(normal)) * normal;
    if constexpr ((Parts & kFriction) != 0) {
      contact.force += spec_.friction->pull(press, normal, contact.force.dot(normal), memory);
      contact.stored += spec_.friction->stored(memory);
    }
    return contact;
  }

  [[nodiscard]] std::vector<Knob> knobs() const override {
    std::vector<Knob> knobs{lead_knob(spec_.elastic.lead)};
    if constexpr ((Parts & kTexture) != 0)
      for (Knob& knob : spec_.texture.height->knobs()) knobs.push_back(std::move(knob));
    return knobs;
  }

  void set(const std::string& knob, double level) override {
    if (knob == "lead") spec_.elastic.lead = level;
    if constexpr ((Parts & kTexture) != 0) spec_.texture.height->set(knob, level);
  }

  [[nodiscard]] std::vector<std::string> remarks() const override {
    std::vector<std::string> remarks;
    if constexpr ((Parts & kTexture) != 0) {
      const double wave = spec_.texture.height->wavelength(), amplitude = spec_.texture.height->amplitude();
      const double fastest = wave * rate_hz_ / kPerWave;
      if (fastest < kHandSpeed)
        remarks.push_back(fmt::format(
            "the texture's finest wavelength of {:.3g} mm fades above {:.3g} mm/s, because a wave needs {:g} "
            "ticks; choose a longer wavelength or a higher rate",
            1e3 * wave, 1e3 * fastest, kPerWave));
      if (resolution_ > 0 && (wave < 4 * resolution_ || amplitude < resolution_))
        remarks.push_back(fmt::format(
            "the texture of {:.3g} mm wavelength and {:.3g} mm amplitude is too fine for the device, whose positions "
            "are {:.3g} mm apart",
            1e3 * wave, 1e3 * amplitude, 1e3 * resolution_));
    }
    return remarks;
  }

 private:
  [[nodiscard]] Elastic spring(double depth) const noexcept {
    if constexpr ((Parts & kLaw) != 0) return spec_.law->at(depth);
    const double force = spec_.elastic.stiffness * depth;
    return {force, spec_.elastic.stiffness, 0.5 * force * depth};
  }

  [[nodiscard]] Contact adhere(Contact contact) const noexcept {
    const AdhesionSpec& adhesion = *spec_.adhesion;
    contact.force = adhesion.stiffness * contact.depth * contact.normal;
    contact.stored = 0.5 * adhesion.stiffness * contact.depth * contact.depth;
    contact.stiffness = adhesion.stiffness;
    contact.damping = 0;
    return contact;
  }

  /// Adds the texture's height to the depth and turns the direction of the force. `vibration` becomes the force that
  /// varies, as a share of the spring's.
  void raise(const Press& press, double& depth, Vec3& direction, double& vibration) const noexcept {
    const Height& height = *spec_.texture.height;
    const Vec3& normal = press.proxy.normal;
    const double speed = norm_of(press.velocity - press.velocity.dot(normal) * normal);
    const HeightSample sample = height.at(press.proxy.position, kPerWave * speed / rate_hz_);
    // The height varies the depth, and the slope the direction.
    const double wave = height.wavelength(), along = 2 * std::numbers::pi / wave;
    const double normal_share = depth > 0 ? std::min(1.0, height.amplitude() / depth) : 1;
    vibration = std::hypot(normal_share, height.amplitude() * along) * std::min(1.0, speed / (wave * kSlowVibration));
    if (spec_.texture.law == TextureLaw::potential) {
      depth += sample.value;
      direction -= press.shape.slide(press.proxy).transpose() * sample.gradient;
      return;
    }
    // M = Ns - grad h + (grad h . Ns) Ns, of unit length.
    const Vec3 raised = direction - sample.gradient + sample.gradient.dot(direction) * direction;
    direction = raised / norm_of(raised);
  }

  DetailedSpec spec_;
  double rate_hz_ = 1000;
  double resolution_ = 0;  ///< of the device's positions [m]
};

template <unsigned Parts>
std::unique_ptr<Surface> make_with(DetailedSpec spec) {
  return std::make_unique<Detailed<Parts>>(std::move(spec));
}

template <std::size_t... Parts>
constexpr auto makers_of(std::index_sequence<Parts...>) {
  return std::array{make_with<Parts>...};
}

double read_crease(JsonReader& reader) {
  const nlohmann::json value = reader.value("shading");
  if (value.is_object()) {
    JsonReader shading(value, reader.where() + ".shading");
    const double crease = shading.number("crease", 45, 0, 180);
    shading.finish();
    return crease * std::numbers::pi / 180;
  }
  if (!value.is_boolean())
    throw input_error(reader.where() + ".shading: expected true, false or {\"crease\": degrees}");
  return value.get<bool>() ? std::numbers::pi / 4 : -1;
}

}  // namespace

std::unique_ptr<Surface> make_detailed(DetailedSpec spec) {
  const unsigned parts = (spec.law ? kLaw : 0U) | (spec.crease ? kShading : 0U) | (spec.friction ? kFriction : 0U) |
                         (spec.texture.height ? kTexture : 0U) | (spec.adhesion ? kAdhesion : 0U);
  static constexpr auto kMakers = makers_of(std::make_index_sequence<kAllParts>{});
  return kMakers[parts](std::move(spec));
}

std::unique_ptr<Surface> read_surface(JsonReader& reader, SceneFiles& files) {
  DetailedSpec spec;
  spec.law = read_stiffness_law(reader);
  if (spec.law && reader.has("stiffness"))
    throw input_error(reader.where() + ": 'stiffness' states a linear law beside another one; keep one of them");
  spec.elastic = spec.law ? read_damping(reader) : read_elastic(reader);
  if (reader.has("shading"))
    if (const double crease = read_crease(reader); crease >= 0) spec.crease = crease;
  if (std::optional<JsonReader> friction = reader.object("friction"))
    spec.friction = read_friction(std::move(*friction), spec.law ? kDefaultBristle : spec.elastic.stiffness);
  if (std::optional<JsonReader> texture = reader.object("texture"))
    spec.texture = read_texture(std::move(*texture), files);
  if (std::optional<JsonReader> adhesion = reader.object("adhesion")) {
    const double stiffness = std::max(1.0, spec.law ? kDefaultBristle : spec.elastic.stiffness);
    spec.adhesion = AdhesionSpec{.force = adhesion->require("force").number("force", 0, 0, kMostAdhesion),
                                 .stiffness = adhesion->number("stiffness", stiffness, 1, 1e9)};
    adhesion->finish();
  }
  const bool plain = !spec.law && !spec.crease && !spec.friction && !spec.texture.height && !spec.adhesion;
  if (plain) return std::make_unique<ElasticSurface>(spec.elastic);
  return make_detailed(std::move(spec));
}

}  // namespace haptrace
