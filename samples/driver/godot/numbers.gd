# Vectors and matrices as arrays of numbers, numbers between rows, and damped springs. One text for Godot 3 and 4.

# Steps per second, at least, in which flesh swings; greatest change of a swing per second, over its limit; iterations of
# Newton's method.
const STEPS = 360.0
const FASTEST = 24.0
# Seconds over which a speed that the limit took counts against kicks the other way.
const FADE = 1.0 / 30.0
const ITERATIONS = 30


# Godot 3 rounds max, min and clamp to float32, and wrinkles start like a square root.
static func larger(a, b):
	return a if a > b else b


static func smaller(a, b):
	return a if a < b else b


static func held(x, low, high):
	return smaller(larger(x, low), high)


static func dot(a, b):
	var found = 0.0
	for i in range(a.size()):
		found += a[i] * b[i]
	return found


static func length(a):
	return sqrt(dot(a, a))


# a + factor * b
static func sum(a, b, factor = 1.0):
	var found = []
	for i in range(a.size()):
		found.append(a[i] + factor * b[i])
	return found


static func times(factor, a):
	var found = []
	for each in a:
		found.append(factor * each)
	return found


static func cross(a, b):
	return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


static func columns(m):
	return [[m[0], m[1], m[2]], [m[4], m[5], m[6]], [m[8], m[9], m[10]]]


static func turn(m):
	var found = []
	for column in columns(m):
		var size = length(column)
		found.append(times(1.0 / size if size > 0 else 1.0, column))
	return found


static func scale(m):
	var c = columns(m)
	return pow(abs(dot(c[0], cross(c[1], c[2]))), 1.0 / 3.0)


static func moved(m, p):
	var found = []
	for i in range(3):
		found.append(m[i] * p[0] + m[i + 4] * p[1] + m[i + 8] * p[2] + m[i + 12])
	return found


# A row of numbers between rows at sorted xs, held before the first and after the last.
static func row(xs, rows, x):
	var after = 0
	while after < xs.size() and xs[after] <= x:
		after += 1
	if after == 0:
		return rows[0]
	if after == xs.size():
		return rows[after - 1]
	var part = (x - xs[after - 1]) / (xs[after] - xs[after - 1])
	return sum(rows[after - 1], sum(rows[after], rows[after - 1], -1.0), part)


static func number(xs, ys, x):
	var rows = []
	for y in ys:
		rows.append([y])
	return row(xs, rows, x)[0]


# The column of points [x, y, z, ...] at x.
static func point(points, x, column = 1):
	var xs = []
	var ys = []
	for each in points:
		xs.append(each[0])
		ys.append(each[column])
	return number(xs, ys, x)


# What is left of a unit of place, and of a unit of speed, after so many radians.
static func decay(damping, turns):
	if damping == 1.0:
		return [exp(-turns), turns * exp(-turns)]
	var swing = sqrt(abs(1.0 - damping * damping))
	if damping < 1.0:
		return [exp(-damping * turns) * cos(swing * turns), exp(-damping * turns) * sin(swing * turns) / swing]
	var fading = exp((swing - damping) * turns)
	var x = -2.0 * swing * turns
	var faster = x + x * x / 2.0 if abs(x) < 1e-5 else exp(x) - 1.0
	return [fading * (1.0 + faster / 2.0), -fading * faster / (2.0 * swing)]


static func remaining(spring, seconds):
	var kept = decay(spring["damping"], 2.0 * PI * spring["frequency"] * larger(seconds, 0.0))
	return kept[0] + spring["damping"] * kept[1]


# Place and speed per radian after a frame that draws along a straight line.
static func passed(state, from, to, damping, turns):
	var slope = (to - from) / turns
	var kept = decay(damping, turns)
	var p = state[0] - from + 2.0 * damping * slope
	var q = state[1] - slope
	var end = to - 2.0 * damping * slope + kept[0] * p + kept[1] * (q + damping * p)
	return [end, slope + kept[0] * q - kept[1] * (p + damping * q)]


static func blend(from, to, part):
	return sum(times(1.0 - part, from), to, part)


# Steps of a frame of so many seconds; 1 where these are not known.
static func steps(elapsed):
	return int(larger(ceil(STEPS * elapsed - 1e-6), 1.0)) if elapsed > 0 else 1


# A swing, none of which is beyond the limit of 1.
static func limited(n):
	return times(1.0 / larger(length(n), 1.0), n)


# The places at which springs rest under steady loads F: |n| = F (1 - |n|^4).
static func rested(loads):
	var size = length(loads)
	var found = smaller(size, 1.0)
	for _k in range(ITERATIONS):
		found -= (size * pow(found, 4) + found - size) / (4.0 * size * pow(found, 3) + 1.0)
	return times(found / size if size > 0 else 0.0, loads)


# Of a push, |n|^4 of what goes further out does not act.
static func _inward(n, push):
	return sum(push, n, -dot(n, n) * larger(dot(n, push), 0.0))


# Places and speeds over ω of springs that swing together within a limit of 1, and the speeds that the limit took, after
# some seconds in which each is free.
# They begin with `kicks` of the speeds, under steady `loads`.
static func swung(state, springs, kicks, loads, seconds):
	var n = state[0]
	var lost = state[2]
	var pushes = _inward(n, kicks)
	var size = dot(lost, lost)
	var share = smaller(larger(-dot(pushes, lost), 0.0), size) / size if size > 0 else 0.0
	var kicked = sum(sum(state[1], pushes), lost, share)
	var rest = _inward(n, loads)
	var taken = 0.0
	for k in range(springs.size()):
		taken += pow(kicked[k] * larger(2.0 * PI * springs[k]["frequency"] / FASTEST, 1.0), 2)
	var room = larger(1.0 - dot(n, n), 0.0)
	var kept = sqrt(room / taken) if taken > room else 1.0
	n = limited(n)
	var fade = exp(-seconds / FADE)
	var ends = [[], [], sum(times(fade * (1.0 - share), lost), kicked, fade * (1.0 - kept))]
	for k in range(springs.size()):
		var damping = springs[k]["damping"]
		var left = decay(damping, 2.0 * PI * springs[k]["frequency"] * seconds)
		var y = n[k] - rest[k]
		var u = kept * kicked[k]
		ends[0].append(rest[k] + left[0] * y + left[1] * (u + damping * y))
		ends[1].append(left[0] * u - left[1] * (y + damping * u))
	return ends
