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

/// Returns the largest length of J v for a unit vector v. J is the derivative of a proxy's place, which is symmetric
/// and moves in a plane: so it has two values, whose sum is its trace.
double stretch_of(const Eigen::Matrix3d& slide) noexcept {
  const double sum = slide.trace();
  return 0.5 * (sum + std::sqrt(std::max(0.0, 2 * slide.squaredNorm() - sum * sum)));
}

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
    double reach = 0;
    if constexpr ((Parts & kAdhesion) != 0) reach += spec_.adhesion->reach();
    if constexpr ((Parts & kTexture) != 0)
      if (raised()) reach += spec_.texture.height->highest();
    return reach;
  }

  [[nodiscard]] SurfaceParts parts() const noexcept override {
    return {.shading = (Parts & kShading) != 0,
            .friction = (Parts & kFriction) != 0,
            .texture = (Parts & kTexture) != 0,
            .adhesion = (Parts & kAdhesion) != 0};
  }

  [[nodiscard]] AdhesionSpec adhesion() const noexcept override { return spec_.adhesion.value_or(AdhesionSpec{}); }

  [[nodiscard]] bool raised() const noexcept override {
    if constexpr ((Parts & kTexture) != 0) return spec_.texture.law == TextureLaw::potential;
    return false;
  }

  [[nodiscard]] double height(const Vec3& proxy) const noexcept override {
    if constexpr ((Parts & kTexture) != 0) return spec_.texture.height->at(proxy, 0).value;
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

    Vec3 direction = proxy.normal;
    if constexpr ((Parts & kShading) != 0) direction = press.shape.smooth(proxy, *spec_.crease);
    // A texture turns the direction.
    // NOLINTNEXTLINE(performance-unnecessary-copy-initialization)
    const Vec3 normal = direction;
    if constexpr ((Parts & kTexture) != 0) raise(press, contact, direction);
    if constexpr ((Parts & (kTexture | kAdhesion)) != 0)
      if (!(contact.depth > 0)) return in_front(contact, direction, memory);
    const Elastic elastic = spring(contact.depth);
    contact.force = elastic.force * direction;
    contact.stored = elastic.stored;
    contact.stiffness = elastic.stiffness;
    contact.force += spec_.elastic.damping * std::max(0.0, -press.velocity.dot(normal)) * normal;
    if constexpr ((Parts & kFriction) != 0) {
      contact.force += spec_.friction->pull(press, normal, contact.force.dot(normal), memory);
      contact.stored += spec_.friction->stored(memory);
    }
    if constexpr ((Parts & kTexture) != 0 && (Parts & kAdhesion) != 0) memory.used = memory.stuck = true;
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
      if (!raised())
        remarks.emplace_back(
            "the law 'bump' of the texture can drive the hand: a closed stroke may give energy; 'potential' does not");
    }
    return remarks;
  }

 private:
  [[nodiscard]] double force_at(double depth) const noexcept { return depth > 0 ? spring(depth).force : 0; }

  [[nodiscard]] Elastic spring(double depth) const noexcept {
    if constexpr ((Parts & kLaw) != 0) return spec_.law->at(depth);
    const double force = spec_.elastic.stiffness * depth;
    return {force, spec_.elastic.stiffness, 0.5 * force * depth};
  }

  /// Completes the contact of a tool in front of the surface, which an adhesion may still hold.
  [[nodiscard]] Contact in_front(Contact contact, const Vec3& direction, SurfaceMemory& memory) const noexcept {
    bool holds = (Parts & kAdhesion) != 0;
    // The reach of a raised surface is more than the adhesion's, and the tool may be on its way in.
    if constexpr ((Parts & kTexture) != 0 && (Parts & kAdhesion) != 0)
      holds = !raised() || (memory.stuck && -contact.depth <= spec_.adhesion->reach());
    if (!holds) {
      memory = {};
      return contact;
    }
    const double stiffness = adhesion().stiffness;
    contact.force = stiffness * contact.depth * direction;
    contact.stored = 0.5 * stiffness * contact.depth * contact.depth;
    contact.stiffness = stiffness;
    contact.damping = 0;
    contact.clings = true;
    return contact;
  }

  /// Adds the texture's height to the depth, or turns the direction of the force, and declares the force that varies.
  void raise(const Press& press, Contact& contact, Vec3& direction) const noexcept {
    const Height& height = *spec_.texture.height;
    const Vec3& normal = press.proxy.normal;
    const double speed = norm_of(press.velocity - press.velocity.dot(normal) * normal);
    const HeightSample sample = height.at(press.proxy.position, kPerWave * speed / rate_hz_);
    if (raised()) {
      contact.depth += sample.value;
      contact.proxy += sample.value * normal;
    }
    // The height varies the depth, and the slope the direction.
    const double share = std::min(1.0, speed / (height.wavelength() * kSlowVibration));
    if (raised()) {
      const HeightRange range = height.range();
      const double most = force_at(press.proxy.depth + range.high), least = force_at(press.proxy.depth + range.low);
      const Eigen::Matrix3d slide = press.shape.slide(press.proxy);
      contact.vibration = share * std::hypot(0.5 * (most - least), most * sample.steepest * stretch_of(slide));
      direction -= slide.transpose() * sample.gradient;
      return;
    }
    // A force that keeps its size turns by less than a right angle.
    contact.vibration = share * force_at(contact.depth) * std::min(sample.steepest, std::numbers::sqrt2);
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
