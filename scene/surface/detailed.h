// A surface with more than a spring: other stiffness laws, shading, friction, texture, adhesion.
#pragma once

#include "base/json_reader.h"
#include "scene/scene_files.h"
#include "scene/surface/elastic.h"
#include "scene/surface/friction.h"
#include "scene/surface/stiffness_law.h"
#include "scene/surface/texture/texture.h"

#include <memory>
#include <optional>

namespace haptrace {

/// The parts of a detailed surface; what is absent executes nothing.
struct DetailedSpec {
  ElasticSpec elastic;  ///< its stiffness is not used if there is a law
  std::optional<StiffnessLaw> law;
  std::optional<double> crease;  ///< force shading up to this angle between faces [rad]
  std::optional<Friction> friction;
  Texture texture;  ///< no height: none
  std::optional<AdhesionSpec> adhesion;
};

/// Makes the surface. With depth d, height h at the proxy and energy U of the stiffness law, the force of the potential
/// texture is
///
///     F = U'(d + h) (n - J^T grad h)      J = Shape::slide(), the derivative of the proxy's place
///
/// which is the gradient of U(d + h). So the tool is touched where d + h > 0: crests are felt in front of the shape,
/// and in valleys nothing is felt behind it. An adhesion pulls from d + h = 0 on. With shading n is the smooth normal.
/// Friction acts on the load |F.n|. A texture part fades where the tool's speed over its wavelength passes a fifth of
/// the rate: kPerWave samples to a wave.
std::unique_ptr<Surface> make_detailed(DetailedSpec spec);

inline constexpr double kPerWave = 5;  ///< ticks

/// Reads a surface: the plain one unless the keys name more.
std::unique_ptr<Surface> read_surface(JsonReader& reader, SceneFiles& files);

}  // namespace haptrace
