#include "paint.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "random.h"

namespace revisit::simulation {
namespace {

using Vec2f = Eigen::Vector2f;
using Vec3 = Eigen::Vector3f;

/// Fraction of [x - f/2, x + f/2] within [low, high]: a step not sharper than a pixel.
float within(float x, float low, float high, float f) {
  const float half = std::max(f, 1e-4f) / 2;
  return std::clamp((std::min(x + half, high) - std::max(x - half, low)) / (2 * half), 0.f, 1.f);
}
float beyond(float x, float edge, float f) {
  return within(x, edge, 1e6f, f);
}
float blend(float a, float b, float share) {
  return a + (b - a) * share;
}

/// Returns a random number in [0, 1) for property `which` of a thing.
float lot(uint64_t thing, uint64_t which) {
  return unit_float(random_bits(thing, which));
}

struct Spot {
  const SurfacePoint& point;
  const Textures& textures;
  const Mesh& mesh;
  const Object& object;
  uint64_t thing;  // hash of Object::kind
  float f;         // footprint [m]
  float reflectance;

  Vec3 local() const {  // [m], object frame
    return turned(point.position - object.origin);
  }
  Vec3 local_normal() const { return turned(point.normal); }

  /// Position along the sides of the hit quad, from its first corner, and their lengths [m].
  struct OnQuad {
    Vec2f at, size;
  };
  OnQuad on_quad() const {
    // Mesh::quad() makes (0, 1, 2) and (0, 2, 3) of four new corners.
    const auto& t = mesh.triangles[point.hit->triangle];
    const bool lower = t[1] == t[0] + 1;
    const float u = point.hit->u, v = point.hit->v;
    const Vec3 corner = mesh.vertices[t[0]];
    const auto side = [&](uint32_t i) { return (mesh.vertices[t[0] + i] - corner).norm(); };
    const Vec2f size(side(1), side(3));
    return {Vec2f(lower ? u + v : u, lower ? v : u + v).cwiseProduct(size), size};
  }
  /// Returns an id of the hit quad, equal for both its triangles.
  uint64_t quad() const { return random_bits(thing, mesh.triangles[point.hit->triangle][0]); }

  /// Projects to the two axes that the surface spans best [m].
  Vec2f flat(const Vec3& p, const Vec3& n) const {
    const Vec3 a = n.cwiseAbs();
    if (a.z() >= a.x() && a.z() >= a.y()) return {p.x(), p.y()};
    return a.x() > a.y() ? Vec2f(p.y(), p.z()) : Vec2f(p.x(), p.z());
  }
  float tile(const Texture& texture, const Vec2f& at) const {
    return texture.at(at.x() + 5 * lot(thing, 1), at.y(), f);
  }

 private:
  Vec3 turned(const Vec3& p) const {
    const Vec2f& x = object.x_axis;
    return {x.x() * p.x() + x.y() * p.y(), x.x() * p.y() - x.y() * p.x(), p.z()};
  }
};

/// Imitates writing: 3 x 5 dots per letter, in [0, 1]. `at` and `f` are in letters.
float writing(uint64_t text, const Vec2f& at, float f) {
  const float column = std::floor(at.x());
  const uint64_t letter = random_bits(text, static_cast<uint64_t>(static_cast<int64_t>(column)));
  const auto x = static_cast<int>((at.x() - column) * 4), y = static_cast<int>(at.y() * 5);
  const bool ink = x < 3 && at.y() >= 0 && y < 5 && ((letter >> (5 * x + y)) & 1);
  // Dots finer than a pixel are gray.
  return blend(ink ? 1.f : 0.f, 0.4f, std::clamp(f * 4 - 0.6f, 0.f, 1.f));
}

/// Imitates a poster of about one meter, in [0, 1].
float picture(uint64_t which, const Vec2f& at, float f, const Textures& textures) {
  const float x = 5 * lot(which, 1), y = 5 * lot(which, 2);
  return std::clamp(0.5f + 1.6f * (textures.noise.at(at.x() + x, at.y() + y, f) - 1), 0.02f, 0.95f);
}

float asphalt(const Vec2f& p, float f, const Textures& textures) {
  const auto noise = [&](uint64_t which, float wavelength) {
    return static_cast<float>(value_noise(which, static_cast<double>(p.x()),
                                          static_cast<double>(p.y()),
                                          static_cast<double>(wavelength)));
  };
  float albedo = 0.17f * textures.asphalt.at(p.x(), p.y(), f);
  // Noise of wavelength w changes by about 2 / w per meter; this converts values to meters.
  const float patch = 2.f * (noise(0x7061746368, 4) - 0.68f);
  albedo *= 1 - 0.2f * beyond(patch, 0, f);
  constexpr float kCrack = 0.02f;  // half width [m]
  if (f < 10 * kCrack) {
    const float crack = 3 * (noise(0x637261636b, 6) + 0.3f * noise(0x637261, 1.5f) - 0.7f);
    albedo *= 1 - 0.5f * within(crack, -kCrack, kCrack, f);
  }
  // A manhole cover in some 9 m squares.
  const Vec2f square = (p / 9).array().floor();
  const uint64_t cell =
      random_bits(0x6c6964, static_cast<uint64_t>(static_cast<int64_t>(square.x())),
                  static_cast<uint64_t>(static_cast<int64_t>(square.y())));
  const Vec2f lid = 9 * square + Vec2f(1 + 7 * lot(cell, 1), 1 + 7 * lot(cell, 2));
  const float r = (p - lid).norm();
  if (r < 1) {
    albedo = blend(albedo, 0.07f, within(r, -1, 0.33f, f));
    albedo = blend(albedo, 0.24f, within(r, 0.36f, 0.44f, f));
  }
  return albedo;
}

Paint ground(const Spot& spot) {
  const Hit& hit = *spot.point.hit;
  const auto& t = spot.mesh.triangles[hit.triangle];
  const auto kerb = [&](size_t i) { return spot.mesh.from_kerb[t[i]]; };
  const float d = kerb(0) + hit.u * (kerb(1) - kerb(0)) + hit.v * (kerb(2) - kerb(0));  // [m]
  const Vec2f p = spot.point.position.head<2>();
  const float f = spot.f;
  const float stain = 0.6f + 0.4f * spot.textures.noise.at(p.x() / 4, p.y() / 4, f / 4);
  const float lawn = beyond(d, 1.9f, f);
  float albedo = d > f ? 0 : asphalt(p, f, spot.textures);
  albedo = blend(albedo, 0.12f, within(d, -0.3f, 0, f));  // gutter
  albedo = blend(albedo, 0.48f, within(d, 0, 0.2f, f));   // kerb stone
  if (const float slabs = beyond(d, 0.2f, f); slabs > 0 && lawn < 1)
    albedo = blend(albedo, 0.42f * spot.textures.slabs.at(p.x(), p.y(), f), slabs);
  if (lawn > 0) albedo = blend(albedo, 0.2f * spot.textures.lawn.at(p.x(), p.y(), f), lawn);
  return {albedo * stain, 0};
}

Paint wall(const Spot& spot) {
  const Vec3 n = spot.local_normal(), p = spot.local();
  const Vec2f at = spot.flat(p, n);
  const float f = spot.f;
  const uint64_t side = random_bits(spot.thing, std::abs(n.x()) > 0.7f ? 1 : 2, n.sum() > 0);
  const float kind = lot(spot.thing, 2);
  const Texture& skin = kind < 0.5f    ? spot.textures.plaster
                        : kind < 0.75f ? spot.textures.brick
                        : kind < 0.87f ? spot.textures.stone
                                       : spot.textures.boards;
  const float tone = kind < 0.5f ? 1.15f * spot.reflectance : 0.7f * spot.reflectance;
  const Vec2f stain = at / 2 + Vec2f(5 * lot(side, 3), 0);
  float albedo = tone * spot.tile(skin, at) *
                 (0.75f + 0.25f * spot.textures.noise.at(stain.x(), stain.y(), f / 2));
  if (lot(spot.thing, 4) < 0.4f)  // painted base
    albedo = blend(albedo, 0.6f * albedo, within(at.y(), -9, 0.7f, f));
  if (lot(spot.thing, 5) < 0.35f && std::abs(n.y()) > 0.7f) {  // sign above the ground floor
    const float low = 2.62f, high = 3.1f;
    const float board = within(at.y(), low, high, f);
    if (board > 0) {
      const float paper = 0.1f + 0.7f * lot(side, 6), ink = paper > 0.45f ? 0.05f : 0.8f;
      const Vec2f letters((at.x() + 50) / 0.34f, (at.y() - low - 0.08f) / 0.32f);
      const bool written = lot(side, 7 + static_cast<uint64_t>(letters.x() / 7)) < 0.7f;
      const float text = written ? writing(side, letters, f / 0.34f) : 0;
      albedo = blend(albedo, blend(paper, ink, text), board);
    }
  }
  const float column = std::floor(at.x() / 2.7f);
  const uint64_t bill = random_bits(side, static_cast<uint64_t>(static_cast<int64_t>(column)), 9);
  if (lot(bill, 1) < 0.3f) {
    const Vec2f size(0.5f + 1.1f * lot(bill, 2), 0.4f + 0.8f * lot(bill, 3));
    const Vec2f on = at - Vec2f(2.7f * column + 0.3f, 0.5f + 1.2f * lot(bill, 4));
    const float share = within(on.x(), 0, size.x(), f) * within(on.y(), 0, size.y(), f);
    if (share > 0) albedo = blend(albedo, 0.1f + 0.6f * picture(bill, on, f, spot.textures), share);
  }
  return {albedo, 0};
}

Paint roof(const Spot& spot) {
  const Vec3 n = spot.local_normal(), p = spot.local();
  const float steep = std::sqrt(std::max(1 - n.z() * n.z(), 0.f));
  const Vec2f at = steep < 0.2f                        ? Vec2f(p.x(), p.y())
                   : std::abs(n.x()) > std::abs(n.y()) ? Vec2f(p.y(), p.z() / steep)
                                                       : Vec2f(p.x(), p.z() / steep);
  return {0.7f * spot.reflectance * spot.tile(spot.textures.roof_tiles, at), 0};
}

Paint window(const Spot& spot) {
  const Vec2f at = spot.on_quad().at, size = spot.on_quad().size;
  const uint64_t pane = spot.quad();
  const float f = spot.f;
  float albedo = 0.04f;
  if (lot(pane, 1) < 0.45f) {  // curtains on both sides
    const float wide = size.x() * (0.12f + 0.25f * lot(pane, 2));
    const float folds = 0.4f * spot.textures.bark.at(at.x() / 4, 0.3f, f / 4);
    albedo = blend(albedo, folds, 1 - within(at.x(), wide, size.x() - wide, f));
  }
  if (lot(pane, 3) < 0.3f)  // partly closed blind
    albedo = blend(albedo, 0.5f, beyond(at.y(), size.y() * (0.3f + 0.6f * lot(pane, 4)), f));
  float bars = 0;
  const float bar = 0.035f;
  const auto vertical = [&](float x) {
    bars = std::max(bars, within(at.x(), x - bar, x + bar, f));
  };
  const auto level = [&](float y) { bars = std::max(bars, within(at.y(), y - bar, y + bar, f)); };
  const float style = lot(spot.thing, 10);  // per house
  if (size.x() > 0.7f && style < 0.75f) vertical(size.x() / 2);
  if (style < 0.35f) level(size.y() * 0.68f);
  if (style > 0.85f) vertical(size.x() / 3), vertical(size.x() * 2 / 3);
  const float inside =
      within(at.x(), 0.07f, size.x() - 0.07f, f) * within(at.y(), 0.07f, size.y() - 0.07f, f);
  const float frame = lot(spot.thing, 11) < 0.7f ? 0.75f : 0.15f;
  const float covered = std::max(bars, 1 - inside);
  return {blend(albedo, frame, covered), 0.08f * (1 - covered)};
}

Paint door(const Spot& spot) {
  const Vec2f at = spot.on_quad().at, size = spot.on_quad().size;
  const uint64_t leaf = spot.quad();
  const float f = spot.f;
  float albedo = 0.06f + 0.5f * lot(leaf, 1);
  const float x = at.x() / size.x(), fx = f / size.x();
  const auto panel = [&](float low, float high, float tone) {
    albedo = blend(albedo, tone, within(x, 0.2f, 0.8f, fx) * within(at.y(), low, high, f));
  };
  if (lot(leaf, 2) < 0.6f) panel(0.2f, 0.9f, 0.65f * albedo);
  if (lot(leaf, 3) < 0.6f) panel(1.15f, 1.9f, 0.05f);  // glazed
  return {albedo, 0.02f};
}

Paint slats(const Spot& spot, float pitch) {
  const float y = spot.on_quad().at.y(), f = spot.f;
  const float within_slat = y - pitch * std::floor(y / pitch);
  const float gap = within(within_slat, 0, 0.15f * pitch, std::min(f, pitch / 2));
  const float seen = std::clamp(1.5f - f / pitch, 0.f, 1.f);
  const float tone = 0.3f + 0.45f * lot(spot.thing, 12);
  return {tone * (1 - 0.5f * seen * gap - 0.075f * (1 - seen)), 0};
}

Paint traffic_sign(const Spot& spot) {
  const auto [at, size] = spot.on_quad();
  const uint64_t sheet = spot.quad();
  const Vec2f c = at - size / 2;
  const float f = spot.f, half = size.x() / 2;
  const float r = lot(sheet, 1) < 0.6f ? c.norm() : c.cwiseAbs().maxCoeff();
  float albedo = blend(0.25f, 0.85f, within(r, -1, half * 0.78f, f));
  const float letter = half * 0.55f;
  if (within(r, -1, half * 0.7f, f) > 0) {
    const Vec2f text =
        (c + Vec2f(letter, letter * 0.8f)).cwiseQuotient(Vec2f(letter, 1.6f * letter));
    if (text.x() >= 0 && text.x() < 2)
      albedo = blend(albedo, 0.08f, writing(sheet, text, f / letter));
  }
  return {blend(albedo, 0.3f, beyond(r, half, f)), 0.03f};
}

Paint posters(const Spot& spot) {
  const Vec3 p = spot.local();
  constexpr float kRadius = 0.6f, kWide = 0.63f, kHigh = 0.85f;  // [m]
  const Vec2f at((std::atan2(p.y(), p.x()) + std::numbers::pi_v<float>)*kRadius, p.z());
  const Vec2f sheet = at.cwiseQuotient(Vec2f(kWide, kHigh)).array().floor();
  const Vec2f on = at - sheet.cwiseProduct(Vec2f(kWide, kHigh));
  const uint64_t which =
      random_bits(spot.thing, static_cast<uint64_t>(static_cast<int64_t>(sheet.x())),
                  static_cast<uint64_t>(static_cast<int64_t>(sheet.y())));
  const float f = spot.f;
  const float paper =
      within(on.x(), 0.03f, kWide - 0.03f, f) * within(on.y(), 0.03f, kHigh - 0.03f, f);
  const float headline = within(on.y(), 0.62f, 0.76f, f);
  const float text = writing(which, {on.x() / 0.14f, (on.y() - 0.62f) / 0.14f}, f / 0.14f);
  const float print = blend(picture(which, on, f, spot.textures), 0.9f * (1 - text), headline);
  return {blend(0.2f, 0.05f + 0.8f * print, paper), 0.02f};
}

Paint car_body(const Spot& spot) {
  const Vec3 p = spot.local();
  const float f = spot.f;
  float albedo = spot.reflectance;
  if (std::abs(spot.local_normal().z()) < 0.7f) {
    for (const float seam : {-0.95f, 0.05f, 1.05f})
      albedo = blend(albedo, 0.3f * albedo, within(p.x(), seam - 0.012f, seam + 0.012f, f));
    albedo = blend(albedo, 0.5f * albedo, within(p.z(), -1, 0.34f, f));
  }
  return {albedo, 0.05f};
}

Paint car_end(const Spot& spot) {
  const auto [at, size] = spot.on_quad();
  const Vec2f c = at - size / 2;
  const float f = spot.f, x = std::abs(c.x());
  float albedo = spot.reflectance;
  const float middle = within(c.y(), -0.1f, 0.12f, f);
  albedo = blend(albedo, 0.08f, middle * within(x, -1, size.x() * 0.28f, f));  // grille
  albedo = blend(albedo, 0.75f, middle * within(x, size.x() * 0.34f, size.x() * 0.46f, f));
  const float plate = within(x, -1, 0.26f, f) * within(c.y(), -0.06f, 0.06f, f);
  if (plate > 0) {
    const Vec2f text((c.x() + 0.26f) / 0.075f, (c.y() + 0.045f) / 0.09f);
    albedo = blend(albedo, 0.8f - 0.7f * writing(spot.thing, text, f / 0.075f), plate);
  }
  return {albedo, 0.04f};
}

Paint leaves(const Spot& spot) {
  const Vec2f at = spot.flat(spot.point.position, spot.point.normal);
  const float tuft = lot(spot.mesh.triangles[spot.point.hit->triangle][0], 13);
  return {(0.10f + 0.3f * spot.reflectance) * (0.7f + 0.5f * tuft) *
              spot.textures.leaves.at(at.x() + 2 * tuft, at.y(), spot.f),
          0};
}

Paint surface_of(const Texture& texture, const Spot& spot, float tone) {
  return {tone * spot.tile(texture, spot.flat(spot.local(), spot.local_normal())), 0};
}

}  // namespace

Paint paint_at(const SurfacePoint& point, const Textures& textures) {
  const Hit& hit = *point.hit;
  const Mesh& mesh = *hit.mesh;
  const Object& object = mesh.objects[mesh.object_of[hit.triangle]];
  const Spot spot{point,
                  textures,
                  mesh,
                  object,
                  mix(object.kind),
                  point.footprint,
                  static_cast<float>(hit.surface.reflectance) / 255};
  switch (hit.surface.look) {
    case Look::kGround:
      return ground(spot);
    case Look::kWall:
      return wall(spot);
    case Look::kRoof:
      return roof(spot);
    case Look::kWindow:
      return window(spot);
    case Look::kDoor:
      return door(spot);
    case Look::kGarageDoor:
      return slats(spot, 0.25f);
    case Look::kShutter:
      return slats(spot, 0.06f);
    case Look::kStone:
      return surface_of(textures.stone, spot, spot.reflectance);
    case Look::kWood:
      return surface_of(textures.boards, spot, 0.8f * spot.reflectance);
    case Look::kBark:
      return surface_of(textures.bark, spot, 0.6f * spot.reflectance);
    case Look::kLeaves:
      return leaves(spot);
    case Look::kTrafficSign:
      return traffic_sign(spot);
    case Look::kPosters:
      return posters(spot);
    case Look::kCarBody:
      return car_body(spot);
    case Look::kCarEnd:
      return car_end(spot);
    case Look::kCarGlass:
      return {0.03f, 0.1f};
    case Look::kPlain:
      break;
  }
  return {spot.reflectance, 0};
}

}  // namespace revisit::simulation
