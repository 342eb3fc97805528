# Vectors and matrices as arrays of numbers, numbers between rows, and damped springs. One text for Godot 3 and 4.


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


# Place and speed per radian after a frame that draws to a polynomial of the frame's fraction.
static func passed(state, powers, damping, turns):
	var answer = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
	for k in [3, 2, 1, 0]:
		answer[k] = powers[k] - 2.0 * damping * (k + 1) * answer[k + 1] / turns
		answer[k] -= (k + 1) * (k + 2) * answer[k + 2] / (turns * turns)
	var kept = decay(damping, turns)
	var p = state[0] - answer[0]
	var q = state[1] - answer[1] / turns
	var end = answer[0] + answer[1] + answer[2] + answer[3]
	var speed = (answer[1] + 2.0 * answer[2] + 3.0 * answer[3]) / turns
	return [end + kept[0] * p + kept[1] * (q + damping * p), speed + kept[0] * q - kept[1] * (p + damping * q)]
