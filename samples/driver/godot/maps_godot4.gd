# Blends wrinkle maps in Godot 4: a node right below the root of an imported scene, in place of driver_godot4.gd.
#
# `maps` is the maps.json that `wrinkle maps` wrote, with its images in the same folder. The scene is the asset as it was, and
# `gltf` its file. Materials get the shader wrinkle_maps.gdshader, which stands beside this file with wrinkle_maps.gdshaderinc.
extends "driver_godot4.gd"

const CHANNELS = ["r", "g", "b", "a"]
# Sets of maps of the shader, each with one mask.
const SETS = 2

@export_file("*.json") var maps = ""
# Load images as they are, in place of what the editor has imported, which may have lost digits to compression.
@export var from_files = false


func _ready():
	process_priority = 100
	var file = read(gltf)
	var known = JSON.parse_string(FileAccess.get_file_as_string(maps))
	if not known is Dictionary:
		push_warning("wrinkle: cannot read %s" % maps)
		return
	for node in known["nodes"]:
		add(file, {"name": node["node"]}, node["wrinkle"])
	for each in bodies:
		each["materials"] = []
		for material in known["materials"]:
			if plain(material["node"]) == plain(each["meshes"][0].name):
				blend(each, material)


# Maps have no morph targets: the drives of a body are all there.
func body_of(wrinkle, joints, _targets):
	return Wrinkle.new(wrinkle, joints)


# Gives the surfaces that have a material a shader in its place, with the maps.
func blend(each, material):
	var mesh = each["meshes"][0]
	for surface in range(mesh.mesh.get_surface_count()):
		var own = mesh.get_active_material(surface)
		var label = plain(own.resource_name) if own != null else ""
		if mesh.mesh.get_surface_count() > 1 and label != plain(material["name"]):
			continue
		var shown = ShaderMaterial.new()
		shown.shader = load(get_script().resource_path.get_base_dir().path_join("wrinkle_maps.gdshader"))
		shown.set_shader_parameter("wrinkle_uv", int(material["texCoord"]))
		if own is BaseMaterial3D:
			take(shown, own)
		var weights = []
		for k in range(material["sets"].size()):
			weights.append(set_of(shown, material["sets"][k], k + 1))
		each["materials"].append({"material": shown, "weights": weights})
		mesh.set_surface_override_material(surface, shown)


# What the imported material has.
func take(shown, own):
	shown.set_shader_parameter("albedo", own.albedo_color)
	shown.set_shader_parameter("metallic", own.metallic)
	shown.set_shader_parameter("roughness", own.roughness)
	shown.set_shader_parameter("normal_scale", own.normal_scale)
	for pair in [["texture_albedo", own.albedo_texture], ["texture_orm", own.roughness_texture], ["texture_normal", own.normal_texture]]:
		if pair[1] != null:
			shown.set_shader_parameter(pair[0], pair[1])


# Gives a material the images of a set; the names of the weights in the channels of its mask.
func set_of(shown, maps_of_set, number):
	var weights = ["", "", "", ""]
	var mask = null
	for each in maps_of_set["weights"]:
		if number > SETS or (mask != null and each.get("mask") != mask):
			push_warning("wrinkle: %s does not show: the shader blends %d sets with one mask each" % [each["target"], SETS])
			continue
		mask = each.get("mask")
		weights[CHANNELS.find(each.get("channel", "r"))] = each["target"]
	for kind in ["normal", "ao"]:
		if maps_of_set.has(kind) and number <= SETS:
			shown.set_shader_parameter("wrinkle_%s_%d" % [kind, number], image(maps_of_set[kind]))
	if mask != null and number <= SETS:
		shown.set_shader_parameter("wrinkle_mask_%d" % number, image(mask))
	return weights


func image(label):
	var path = maps.get_base_dir().path_join(label)
	if not from_files and ResourceLoader.exists(path):
		return load(path)
	var found = Image.new()
	found.load_png_from_buffer(FileAccess.get_file_as_bytes(path))
	found.generate_mipmaps()
	return ImageTexture.create_from_image(found)


func show_weights(each, found, _morphs):
	for shown in each["materials"]:
		for k in range(min(shown["weights"].size(), SETS)):
			var vector = Vector4()
			for channel in range(4):
				vector[channel] = found.get(shown["weights"][k][channel], 0.0)
			shown["material"].set_shader_parameter("wrinkle_weights_%d" % (k + 1), vector)
