# What Godot 4 makes of a bake, of the driver's files and of wrinkle maps, in a page of a browser.
#
# The pack has this file, answers.gd, the driver's files, vectors.json, in.glb, and in folders of one asset's maps: plain.glb,
# maps.json and images. The page calls what stands in `window.godot`, and gets answers as `window.answer`.
extends Node3D

# Poses of imported clips a second.
const FPS = 240.0

var window = JavaScriptBridge.get_interface("window")
var calls = {}
var scene
var player


func _ready():
	var object = JavaScriptBridge.create_object("Object")
	for each in ["open", "seek", "vectors", "driven", "blended", "picture"]:
		calls[each] = JavaScriptBridge.create_callback(Callable(self, each))
		object[each] = calls[each]
	window.godot = object
	var camera = Camera3D.new()
	camera.near = 0.01
	add_child(camera)
	camera.look_at_from_position(Vector3(0.3, 0.5, 4.0), Vector3.ZERO)
	var light = DirectionalLight3D.new()
	add_child(light)


# Shows a file of the pack, with tangents as the editor's importer makes them, at the beginning of a clip.
func open(arguments):
	if scene != null:
		scene.free()
	var document = GLTFDocument.new()
	var state = GLTFState.new()
	var file = FileAccess.get_file_as_bytes("res://" + arguments[0])
	document.append_from_buffer(file, "", state, 8)
	scene = document.generate_scene(state, FPS)
	add_child(scene)
	player = scene.find_child("AnimationPlayer")
	player.play(arguments[1])
	player.pause()


func seek(arguments):
	player.seek(arguments[0], true)


func vectors(_arguments):
	var cases = JSON.parse_string(FileAccess.get_file_as_string("res://vectors.json"))
	answer(load("res://answers.gd").all(cases, null))


# For each of some frames of a clip and each target: the weight of its track, and that of the driver's node.
func driven(arguments):
	var node = load("res://driver_godot4.gd").new()
	node.gltf = "res://" + arguments[0]
	scene.add_child(node)
	var rows = []
	for frame in range(61):
		var time = player.current_animation_length * frame / 60.0
		player.seek(time, true)
		for body in node.bodies:
			for target in body["body"].driven():
				var property = body["shapes"][0][target]
				rows.append([time, body["meshes"][0].get(property)])
				body["meshes"][0].set(property, -1.0)
			node.drive(arguments[1], time, 1.0 / 30.0)
			for k in range(body["body"].driven().size()):
				var shown = body["meshes"][0].get(body["shapes"][0][body["body"].driven()[k]])
				rows[rows.size() - body["body"].driven().size() + k].append(shown)
	node.free()
	answer(rows)


# What the shader's function gives all over the texture of a folder's maps, for four weights of each set: a picture of
# normals, with occlusion as alpha.
func blended(arguments):
	var shader = Shader.new()
	shader.code = '
		shader_type canvas_item;
		render_mode blend_disabled;
		#include "res://wrinkle_maps.gdshaderinc"
		void fragment() {
			float ao = 1.0;
			vec3 normal = wrinkle(UV, vec4(0.5, 0.5, 1.0, 1.0), 1.0, ao);
			COLOR = vec4(normal, ao);
		}
	'
	var node = load("res://maps_godot4.gd").new()
	node.maps = "res://%s/maps.json" % arguments[0]
	var material = ShaderMaterial.new()
	material.shader = shader
	var known = JSON.parse_string(FileAccess.get_file_as_string(node.maps))
	var sets = known["materials"][0]["sets"]
	for k in range(sets.size()):
		node.set_of(material, sets[k], k + 1)
		var weights = Vector4(arguments[4 * k + 1], arguments[4 * k + 2], arguments[4 * k + 3], arguments[4 * k + 4])
		material.set_shader_parameter("wrinkle_weights_%d" % (k + 1), weights)
	node.free()
	var view = SubViewport.new()
	view.size = Vector2i.ONE * int(known["size"])
	view.transparent_bg = true
	view.render_target_update_mode = SubViewport.UPDATE_ALWAYS
	var rectangle = ColorRect.new()
	rectangle.size = view.size
	rectangle.material = material
	view.add_child(rectangle)
	add_child(view)
	await drawn()
	answer(Marshalls.raw_to_base64(view.get_texture().get_image().save_png_to_buffer()))
	view.free()


# A picture of the scene at a time, by its own morph targets or by maps of a folder, in raking light.
func picture(arguments):
	var at = Vector3(arguments[2], arguments[3], arguments[4])
	var camera = get_viewport().get_camera_3d()
	camera.look_at_from_position(at, Vector3(arguments[5], arguments[6], arguments[7]))
	for each in get_children():
		if each is DirectionalLight3D:
			each.basis = camera.basis * Basis.looking_at(Vector3(2, -1.5, -0.7))
	var node = null
	if arguments[1] != "":
		node = load("res://maps_godot4.gd").new()
		node.maps = "res://%s/maps.json" % arguments[1]
		node.gltf = "res://%s/plain.glb" % arguments[1]
		scene.add_child(node)
	player.seek(arguments[0], true)
	await drawn()
	answer(Marshalls.raw_to_base64(get_viewport().get_texture().get_image().save_png_to_buffer()))
	if node != null:
		node.free()


func drawn():
	for frame in range(3):
		await RenderingServer.frame_post_draw


func answer(value):
	window.answer = JSON.stringify(value, "", false, true)
