"""How often each formula of the tracer that is judged rounds.

Rays, hits, normals and texture coordinates are in double, and so are all decisions what faces whom; searches, light
and colour are in single. u = 2^-24 bounds the relative error of one rounding to single precision, v = 2^-53 to double.
Dot products are by fused multiply-adds: three roundings, of partial sums that never exceed the sum of the sizes of the
products. Coordinates count as they stand in the scene: a tracer that first moves a far scene to the origin stays within
these bounds, which are then looser than they need be.
"""

from __future__ import annotations

U = 2.0**-24
V = 2.0**-53

# --- in double: rays, hits, normals

# Direction of a camera ray: an affine function of the film position (three rounded constants, two fused
# operations) divided by its length (three roundings, a root, a division): along d none of that counts; across
# it each component keeps two roundings of partial sums not above 2, and one of its own.
CAMERA_DIRECTION = 5 * V
# Origin of an orthographic ray: two fused operations and a sum, each of at most eye + film.
CAMERA_ORIGIN = 4 * V
# A plane's distance from the origin of a ray: difference 1, unit normal 1, dot product 3.
PLANE_DISTANCE = 5 * V
# The slope d.n: unit normal 1, dot product 3; then reciprocal 1 and product 1.
PLANE_SLOPE = 6 * V
# Radicand r^2 - |foot|^2, in r (r + distance): square 1, squared length 3, difference 1, and twice the 6 roundings of
# the foot (difference 1, dot product 3, fused projection 1, its own 1); half of it is a distance along the normal.
SPHERE_DISTANCE = 8.5 * V
# A reflected direction d - 2 (d.n) / (n.n) n: two dot products of 3, quotient 1, product 1, twice; sum 1.
REFLECTED = 17 * V
# The place in a spot light's cone: three dot products with rounded rows (4), root 3; relative to |M^-1|.
CONE_PLACE = 7 * V
# An arc tangent by Dr.Jit's polynomial, relative to the angle; a test shows that.
ARC_TANGENT = 8 * V
# A point brought through a matrix: matrix 1, dot product 3, sum 1 (and the same for a direction, plus its length 3).
PLACED = 8 * V
# Barycentric weights, relative to the longest side squared / |e1 x e2|: differences 2, two cross products 3 each,
# dot 3, division 2. So in a thin triangle they are worse by its aspect ratio, whatever they then interpolate.
WEIGHTS = 13 * V
# A place in a shape's own axes, as a distance, relative to its size: difference 1, row of an inverse matrix 8 (two
# products and a difference, relative to what they are divided by, and that), dot product 3.
LOCAL = 12 * V
# Texture coordinates made of that: arc tangent 8, scale and offset 3; by a texture's own transform 3, and from that
# to texels 2; relative to 1, or to the coordinates of a mesh's vertices where they are greater.
COORDINATE = 16 * V

# --- in single: what is made of them
# A unit vector from three components, rounded first (1, and 1 that their length takes on): squared length 3 / 2,
# root 1, reciprocal 1, product 1; rounded up.
UNIT_VECTOR = 7 * U
# Vectors that are stored in single: the plane of a polygon, and its normal, of unit length again (2).
POLYGON = 2 * U
# Vertex normals, Mitsuba's own, made from faces: edges 1, cross product 3, unit vector, angle 8, and the sum over
# about six faces.
VERTEX_NORMAL = 24 * U
# Light: the rounded difference, made a unit vector.
TO_LIGHT = UNIT_VECTOR
# A cosine of two such vectors, in units of sum |n_i l_i|: the normal, the light, their product 3.
COSINE = UNIT_VECTOR + TO_LIGHT + 3 * U
# 1 / distance^2: the squared length twice, a reciprocal and a product; times intensity and a term.
IRRADIANCE = 10 * U
# k_d (n.l) + k_s f times I: two products and a sum each, and k itself rounded.
TERM = 5 * U
# exp2(p log2(1 - y)): the chord carries its own roundings (see below). The logarithm: sum 1, reciprocal 1, product 1,
# with a rounded constant 2, fused sum 1; and the product with p.
LOGARITHM = 7 * U
# The power of 2: of an exponent within 1/2 a product with a rounded constant 1, fused sums 2, and the chord's half 1.
POWER = 4 * U
# A colour from a picture: texels are rounded (1), and so is the luminance that may stand for them (1); along both axes
# the weight, the difference of two texels and their sum (6); relative to 1.
TEXEL = 8 * U
# --- searches
# Offset of a ray's start from its surface, in units of the surface's distance from the origin along n, or of what
# a triangle's plane is off that a search makes of its edges: twice the 4 u |e_j f_k| of each product in e x f.
OFFSET = 8 * U
# Origin and vertices in single, those of an instance or of a scene that was moved among them.
TRANSFORMED = 5 * U
# A test of an edge from the origin of the ray (difference of the ends 1, their sum 1, cross product 3, dot
# product 3), divided by the edge; the sum of the ends is up to twice as far as the edge. Or the coordinates of a
# place on a rectangle or disk: of the distance t 11 (difference 1, dot product and normal 4, slope 4, reciprocal 1,
# product 1), of the size 13 (those of the difference, which is greater than t by half the size, 2.5; coordinates 4 of
# half the size; the place 0.5; an edge widened by 16 u of half a side, 8).
EDGE_TEST = 16 * U
# The radicand of a plain quadratic, in squared distances: coefficients 3 each, product 1, difference 1.
QUADRATIC_TEST = 8 * U
